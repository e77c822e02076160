// What a person at the terminal sees and does: progress, warnings, signals.
#pragma once

#include "lpvbake/error.h"
#include "lpvbake/progress.h"

#include <chrono>
#include <string>
#include <vector>

namespace lpvbake::cmd {

/// From now on SIGINT and SIGTERM are noted instead of ending the process at once; the second
/// SIGINT, or the second SIGTERM, ends it. A second after SIGTERM it ends in any case, with what
/// that means: a farm does not wait longer.
void watch_signals();

/// Throws Error (interrupted, terminated) once a signal was noted.
void stop_if_signalled();

/// What was noted is done, the program goes on to its end: which is the error to end with then,
/// interrupted or terminated.
ErrorKind forget_signal();

/// Writes out what is buffered for standard output. Throws Error (file) if any of it was lost.
void finish_stdout();

/// The text with its control characters replaced: names in files may hold line ends, and sequences
/// that a terminal obeys.
std::string on_one_line(std::string text);

/// What -q and -v ask for.
struct Verbosity {
    bool quiet = false;   ///< neither warnings nor progress
    bool verbose = false; ///< what is read and done, too
};
extern Verbosity verbosity;

/// A line on standard error, unless --quiet says otherwise.
void print_warning(const std::string& text);
/// A line on standard error where --verbose asks for it.
void tell(const std::string& text);

/// How progress is shown on standard error; automatic is a bar on a terminal and nothing elsewhere.
enum class ProgressStyle { automatic, bar, plain, percent, openjd, none };

/// A line of Open Job Description (openjd_fail) where progress is shown in its form.
void tell_failure(const std::string& text);

/// Draws a bar with the stage's share and remaining time at most ten times a second, or prints
/// lines "lpvbake: room.gltf: gather 40 %, 2.1 s": subject, stage, share, time since the program's
/// start; one as a stage begins and ends, between them at most one a second. Or at most one a
/// second of how much of all that is expected is done: "40", or "openjd_progress: 40" beside
/// "openjd_status: gather" (OpenJobDescription/openjd-specifications, How Jobs Are Run). Also where
/// a bake learns of signals.
class TerminalProgress : public Progress {
public:
    explicit TerminalProgress(ProgressStyle style, const std::string& subject = "");
    ~TerminalProgress() override { erase(); }
    /// Whose stages the next ones are.
    void set_subject(const std::string& subject) { subject_ = subject; }
    /// What is going to run, and how long it is expected to take.
    void expect(const std::vector<StageReport>& stages);
    void begin(std::string_view stage, uint64_t steps) override;
    void advance(uint64_t done) override;
    /// Takes the bar away.
    void erase();
    /// Ends the last stage, too.
    void end();
    /// Prints a warning of the library beside the bar, each text once.
    void warn(const std::string& said);
    const std::vector<std::string>& warnings() const { return warnings_; }

private:
    void draw(uint64_t done);
    void draw_bar(double share);
    void draw_line(double share) const;
    void draw_whole(double share);
    void end_stage();
    /// How much of all that is expected is done, where the stage has done a share.
    double whole(double share) const;

    using Clock = std::chrono::steady_clock;
    ProgressStyle style_;
    std::string subject_;
    Clock::time_point start_ = Clock::now();
    std::string stage_;
    uint64_t steps_ = 0;
    Clock::time_point begun_{};
    Clock::time_point drawn_{};
    bool visible_ = false;
    std::vector<StageReport> expected_;
    std::size_t at_ = 0;       ///< of those the first that may come next
    double done_before_ = 0.0; ///< as whole(), when the plan came
    double shown_ = 0.0;
    std::vector<std::string> warnings_;
};

} // namespace lpvbake::cmd
