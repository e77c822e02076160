#include "terminal.h"

#include "lpvbake/error.h"
#include "options/wording.h"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>

#include <unistd.h>

namespace lpvbake::cmd {
namespace {

volatile std::sig_atomic_t noted_signal = 0;

extern "C" void note_signal(int signal) {
    noted_signal = signal;
}

} // namespace

void watch_signals() {
    struct sigaction action = {};
    action.sa_handler = note_signal;
    // The handler serves once: a second signal does what it always did. Slow system calls go on.
    action.sa_flags = int(SA_RESETHAND) | SA_RESTART;
    sigemptyset(&action.sa_mask);
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

TerminalProgress::TerminalProgress(ProgressStyle style) : style_(style) {
    if (style != ProgressStyle::automatic)
        return;
    const char* terminal = std::getenv("TERM");
    const bool can_erase = terminal && std::strcmp(terminal, "dumb") != 0;
    style_ = isatty(STDERR_FILENO) == 0 ? ProgressStyle::none
             : can_erase                ? ProgressStyle::bar
                                        : ProgressStyle::plain;
}

void TerminalProgress::begin(std::string_view stage, uint64_t steps) {
    stop_if_signalled();
    stage_ = stage;
    steps_ = steps;
    begun_ = Clock::now();
    drawn_ = {};
    if (style_ == ProgressStyle::plain)
        std::fprintf(stderr, "lpvbake: %s\n", stage_.c_str());
    if (style_ == ProgressStyle::bar)
        draw(0);
}

void TerminalProgress::advance(uint64_t done) {
    stop_if_signalled();
    if (style_ == ProgressStyle::bar && Clock::now() - drawn_ >= std::chrono::milliseconds(100))
        draw(done);
}

void TerminalProgress::draw(uint64_t done) {
    constexpr int width = 24;
    drawn_ = Clock::now();
    visible_ = true;
    if (steps_ == 0) {
        std::fprintf(stderr, "\r\033[K%-12s", stage_.c_str());
        return;
    }
    const double share = std::min(1.0, double(done) / double(steps_));
    std::string bar(std::size_t(width * share), '#');
    bar.resize(width, '.');
    std::fprintf(stderr, "\r\033[K%-12s [%s] %3.0f %%", stage_.c_str(), bar.c_str(), 100 * share);
    const double elapsed = std::chrono::duration<double>(drawn_ - begun_).count();
    if (share > 0 && elapsed > 0.2)
        std::fprintf(stderr, "  ETA %.0f s", elapsed * (1 - share) / share);
}

void TerminalProgress::clear() {
    if (visible_)
        std::fputs("\r\033[K", stderr);
    visible_ = false;
}

void TerminalProgress::warn(const std::string& said) {
    const std::string text = options::in_options(said);
    if (std::find(warnings_.begin(), warnings_.end(), text) != warnings_.end())
        return;
    warnings_.push_back(text);
    clear();
    std::fprintf(stderr, "lpvbake: warning: %s\n", on_one_line(text).c_str());
}

} // namespace lpvbake::cmd
