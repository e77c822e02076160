#include "terminal.h"

#include "exit_code.h"
#include "options/wording.h"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>

#include <unistd.h>

namespace lpvbake::cmd {
namespace {

volatile std::sig_atomic_t noted_signal = 0;

constexpr unsigned patience = 1; ///< seconds after SIGTERM

extern "C" void end_terminated(int) {
    constexpr char text[] = "lpvbake: error: terminated\n";
    [[maybe_unused]] const ssize_t ignored = write(STDERR_FILENO, text, sizeof text - 1);
    _exit(int(ExitCode::terminated));
}

extern "C" void note_signal(int signal) {
    noted_signal = signal;
    if (signal == SIGTERM)
        alarm(patience);
}

/// What of a bake is expected to be the writing.
constexpr double write_share = 0.05;

bool in_openjd = false; ///< a TerminalProgress has this style

} // namespace

void watch_signals() {
    struct sigaction action = {};
    action.sa_handler = note_signal;
    // The handler serves once: a second signal does what it always did. Slow system calls go on.
    action.sa_flags = int(SA_RESETHAND) | SA_RESTART;
    sigemptyset(&action.sa_mask);
    std::signal(SIGALRM, end_terminated);
    for (int signal : {SIGINT, SIGTERM}) {
        struct sigaction present = {};
        sigaction(signal, nullptr, &present);
        if (present.sa_handler != SIG_IGN) // a shell's background job ignores SIGINT: so do we
            sigaction(signal, &action, nullptr);
    }
}

void stop_if_signalled() {
    if (noted_signal == SIGINT)
        throw Error(ErrorKind::interrupted, "interrupted");
    if (noted_signal == SIGTERM)
        throw Error(ErrorKind::terminated, "terminated");
}

ErrorKind forget_signal() {
    const bool terminated = noted_signal == SIGTERM;
    noted_signal = 0;
    alarm(0);
    return terminated ? ErrorKind::terminated : ErrorKind::interrupted;
}

void finish_stdout() {
    std::cout.flush();
    if (std::fflush(stdout) != 0 || std::ferror(stdout) || !std::cout)
        throw Error(ErrorKind::io, "standard output: cannot be written");
}

std::string on_one_line(std::string text) {
    for (char& c : text)
        if (static_cast<unsigned char>(c) < ' ' || c == 127)
            c = '?';
    return text;
}

Verbosity verbosity;

void print_warning(const std::string& text) {
    if (!verbosity.quiet)
        std::fprintf(stderr, "lpvbake: warning: %s\n", on_one_line(text).c_str());
}

void tell(const std::string& text) {
    if (verbosity.verbose)
        std::fprintf(stderr, "lpvbake: %s\n", on_one_line(text).c_str());
}

void tell_failure(const std::string& text) {
    if (in_openjd)
        std::fprintf(stderr, "openjd_fail: %s\n", text.c_str());
}

TerminalProgress::TerminalProgress(ProgressStyle style, const std::string& subject)
    : style_(verbosity.quiet ? ProgressStyle::none : style),
      subject_(subject) {
    in_openjd = style_ == ProgressStyle::openjd;
    if (style_ != ProgressStyle::automatic)
        return;
    if (verbosity.verbose) { // its lines and a bar would part each other
        style_ = ProgressStyle::plain;
        return;
    }
    const char* terminal = std::getenv("TERM");
    const bool can_erase = terminal && std::strcmp(terminal, "dumb") != 0;
    style_ = isatty(STDERR_FILENO) == 0 ? ProgressStyle::none
             : can_erase                ? ProgressStyle::bar
                                        : ProgressStyle::plain;
}

void TerminalProgress::expect(const std::vector<StageReport>& stages) {
    expected_ = stages;
    at_ = 0;
    done_before_ = shown_;
}

void TerminalProgress::begin(std::string_view stage, uint64_t steps) {
    stop_if_signalled();
    end_stage();
    stage_ = stage;
    steps_ = steps;
    begun_ = Clock::now();
    const auto next = std::find_if(expected_.begin() + std::ptrdiff_t(at_), expected_.end(),
                                   [&](const StageReport& each) { return each.name == stage_; });
    if (next != expected_.end())
        at_ = std::size_t(next - expected_.begin());
    if (style_ == ProgressStyle::bar || style_ == ProgressStyle::plain)
        draw(0);
    else
        advance(0);
}

void TerminalProgress::advance(uint64_t done) {
    stop_if_signalled();
    const auto pause = std::chrono::milliseconds(style_ == ProgressStyle::bar ? 100 : 1000);
    if (style_ != ProgressStyle::none && Clock::now() - drawn_ >= pause)
        draw(done);
}

void TerminalProgress::draw(uint64_t done) {
    drawn_ = Clock::now();
    const double share = steps_ == 0 ? 0 : std::min(1.0, double(done) / double(steps_));
    if (style_ == ProgressStyle::plain)
        draw_line(share);
    else if (style_ == ProgressStyle::bar)
        draw_bar(share);
    else
        draw_whole(whole(share));
}

double TerminalProgress::whole(double share) const {
    if (expected_.empty())
        return share;
    const auto seconds = [&](std::size_t end) {
        double sum = 0.0;
        for (std::size_t i = 0; i < end; ++i)
            sum += expected_[i].seconds;
        return sum;
    };
    const double all = seconds(expected_.size());
    double done = all;
    if (stage_ != "write") {
        done = seconds(at_);
        if (at_ < expected_.size() && expected_[at_].name == stage_)
            done += share * expected_[at_].seconds;
    }
    const double solved = all > 0.0 ? done / all : 1.0;
    const double of_write = stage_ == "write" ? write_share * share : 0.0;
    return std::max(shown_, done_before_
                                + (1.0 - done_before_) * ((1.0 - write_share) * solved + of_write));
}

void TerminalProgress::draw_whole(double share) {
    shown_ = expected_.empty() ? 0.0 : share;
    const int percent = int(std::floor(100 * share));
    if (style_ == ProgressStyle::percent)
        std::fprintf(stderr, "%d\n", percent);
    else
        std::fprintf(stderr, "openjd_progress: %d\nopenjd_status: %s\n", percent,
                     on_one_line(stage_).c_str());
}

void TerminalProgress::draw_bar(double share) {
    constexpr int width = 24;
    visible_ = true;
    if (steps_ == 0) {
        std::fprintf(stderr, "\r\033[K%-12s", stage_.c_str());
        return;
    }
    std::string bar(std::size_t(width * share), '#');
    bar.resize(width, '.');
    std::fprintf(stderr, "\r\033[K%-12s [%s] %3.0f %%", stage_.c_str(), bar.c_str(), 100 * share);
    const double elapsed = std::chrono::duration<double>(drawn_ - begun_).count();
    if (share > 0 && elapsed > 0.2)
        std::fprintf(stderr, "  ETA %.0f s", elapsed * (1 - share) / share);
}

void TerminalProgress::draw_line(double share) const {
    const double seconds = std::chrono::duration<double>(Clock::now() - start_).count();
    const std::string what = subject_.empty() ? stage_ : subject_ + ": " + stage_;
    std::fprintf(stderr, "lpvbake: %s %.0f %%, %.1f s\n", on_one_line(what).c_str(),
                 std::floor(100 * share), seconds);
}

void TerminalProgress::end_stage() {
    if (style_ == ProgressStyle::plain && !stage_.empty())
        draw_line(1);
    stage_.clear();
}

void TerminalProgress::end() {
    end_stage();
    erase();
    if (style_ == ProgressStyle::percent || style_ == ProgressStyle::openjd)
        draw_whole(1);
}

void TerminalProgress::erase() {
    if (visible_)
        std::fputs("\r\033[K", stderr);
    visible_ = false;
}

void TerminalProgress::warn(const std::string& said) {
    const std::string text = options::in_options(said);
    if (std::find(warnings_.begin(), warnings_.end(), text) != warnings_.end())
        return;
    warnings_.push_back(text);
    erase();
    print_warning(text);
}

} // namespace lpvbake::cmd
