// Files that appear whole or not at all.
#pragma once

#include "lpvbake/file.h"

#include <cstdint>
#include <deque>
#include <functional>
#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

namespace lpvbake::io {

/// A file that is written under a temporary, hidden name beside its target and takes the target's
/// name when it is complete: after an error, a full disk or a kill there is the old file or the new
/// one. What is not published is removed on destruction; what a killed process left behind for the
/// same target is removed by the next one on the same host. A target that is a symbolic link keeps
/// being one. All members throw Error (file) that names the target and the system's reason.
class AtomicFile {
public:
    /// Removes stale temporaries of `target`. Nothing is created yet.
    explicit AtomicFile(const std::string& target);
    AtomicFile(AtomicFile&& other) noexcept;
    AtomicFile& operator=(AtomicFile&&) = delete;
    ~AtomicFile();

    /// Creates the temporary file with what `fill` puts into the stream (which is seekable).
    void write(const std::function<void(std::ostream&)>& fill);
    void write(std::string_view bytes);

    /// Overwrites part of what was written.
    void patch(uint64_t offset, std::string_view bytes);

    /// Brings the data to the disk, under the temporary name still. Returns the size in bytes.
    uint64_t seal();

    /// Renames the sealed file to its target, or hands it to the PublishTogether that there is.
    void publish();

    /// Where the data are until they are published.
    const std::string& temporary() const { return temporary_; }

private:
    std::string target_; ///< with symbolic links resolved
    std::string temporary_;
    bool exists_ = false;
};

/// While it lives, what is published keeps its temporary name, and what remove_files() is given
/// stays, until publish(), which renames all, one right after the other in their order, and then
/// removes. What is not published is gone on destruction. One within another leaves all to that.
class PublishTogether {
public:
    PublishTogether();
    PublishTogether(const PublishTogether&) = delete;
    PublishTogether& operator=(const PublishTogether&) = delete;
    ~PublishTogether();
    void publish();

private:
    friend class AtomicFile;
    friend void remove_files(const std::vector<std::string>& names);
    std::deque<AtomicFile> files_;
    std::vector<std::string> removed_;
};

/// Files that appear together: `write(file, i)` fills that of the i-th name, several at a time, and
/// none takes its name before all are on the disk.
std::vector<WriteReport::File>
write_together(const std::vector<std::string>& names,
               const std::function<void(AtomicFile&, size_t)>& write);

/// As far as that is possible.
void remove_files(const std::vector<std::string>& names);

/// Throws Error (file), beginning with `name`, for pipes and devices: to open one may wait forever.
void refuse_pipes(const std::string& path, const std::string& name);

/// Throws Error (invalid), "PATH: WHY": what the file says is wrong.
[[noreturn]] void reject(const std::string& path, const std::string& why);

/// Why a file without its end is refused.
inline constexpr const char* cut_off =
    "ends before what its header says: it is cut off or damaged; copy it again, or bake it again";

/// Reads a whole file of at most `max_bytes`. Throws Error (file), or Error (invalid) if it is
/// larger.
std::string read_file(const std::string& path, uint64_t max_bytes);

} // namespace lpvbake::io
