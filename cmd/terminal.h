// What a person at the terminal sees and does: progress, warnings, signals.
#pragma once

#include "lpvbake/progress.h"

#include <chrono>
#include <string>
#include <vector>

namespace lpvbake::cmd {

/// From now on SIGINT and SIGTERM are noted instead of ending the process at once; the second
/// SIGINT, or the second SIGTERM, ends it.
void watch_signals();

/// Throws Error (interrupted, terminated) once a signal was noted.
void stop_if_signalled();

/// Writes out what is buffered for standard output. Throws Error (file) if any of it was lost.
void finish_stdout();

/// The text with its control characters replaced: names in files may hold line ends, and sequences
/// that a terminal obeys.
std::string on_one_line(std::string text);

/// How progress is shown on standard error; automatic is a bar on a terminal and nothing elsewhere.
enum class ProgressStyle { automatic, bar, plain, none };

/// Draws a bar with the stage's share and remaining time at most ten times a second, or prints a
/// line a stage. Also where a bake learns of signals.
class TerminalProgress : public Progress {
public:
    explicit TerminalProgress(ProgressStyle style);
    ~TerminalProgress() override { clear(); }
    void begin(std::string_view stage, uint64_t steps) override;
    void advance(uint64_t done) override;
    /// Takes the bar away.
    void clear();
    /// Prints a warning of the library beside the bar, each text once.
    void warn(const std::string& said);
    const std::vector<std::string>& warnings() const { return warnings_; }

private:
    void draw(uint64_t done);

    using Clock = std::chrono::steady_clock;
    ProgressStyle style_;
    std::string stage_;
    uint64_t steps_ = 0;
    Clock::time_point begun_{};
    Clock::time_point drawn_{};
    bool visible_ = false;
    std::vector<std::string> warnings_;
};

} // namespace lpvbake::cmd
