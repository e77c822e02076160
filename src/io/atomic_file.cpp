#include "io/atomic_file.h"

#include "file_error.h"
#include "lpvbake/error.h"

#include <tbb/parallel_for.h>

#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <utility>

namespace lpvbake::io {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void fail(const std::string& path, const char* verb, int error) {
    throw Error(kind_of_file_error(error),
                path + ": cannot be " + verb + ": "
                    + (error ? std::strerror(error) : "input/output error"));
}

/// Closed at the end of its scope.
struct Descriptor {
    explicit Descriptor(int file) : fd(file) {}
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    ~Descriptor() {
        if (fd >= 0)
            close(fd);
    }
    int fd;
};

fs::path folder_of(const fs::path& file) {
    return file.has_parent_path() ? file.parent_path() : fs::path(".");
}

/// `.NAME.HOST.`, followed by the process, a count and `.tmp`: what temporaries of a target share.
std::string prefix_of(const fs::path& target) {
    char host[65] = {};
    gethostname(host, sizeof host - 1);
    // Names end at 255 bytes; two targets that share the first 150 do no harm.
    return std::string(".")
        .append(target.filename().string(), 0, 150)
        .append(".")
        .append(host)
        .append(".");
}

PublishTogether* together = nullptr; ///< that there is

constexpr std::string_view suffix = ".tmp";

void remove_stale(const fs::path& target) {
    const std::string prefix = prefix_of(target);
    std::error_code ignored; // a folder that cannot be listed fails with a better text later
    for (const auto& entry : fs::directory_iterator(folder_of(target), ignored)) {
        const std::string name = entry.path().filename();
        if (!name.starts_with(prefix) || !name.ends_with(suffix))
            continue;
        pid_t pid = 0;
        std::from_chars(name.data() + prefix.size(), name.data() + name.size(), pid);
        if (pid > 0 && kill(pid, 0) != 0 && errno == ESRCH)
            fs::remove(entry.path(), ignored);
    }
}

} // namespace

AtomicFile::AtomicFile(const std::string& target) : target_(target) {
    static std::atomic<unsigned> count = 0;
    std::error_code error;
    if (fs::is_symlink(target, error))
        if (const fs::path real = fs::weakly_canonical(target, error); !error)
            target_ = real;
    const fs::path path(target_);
    if (!path.has_filename() || fs::is_directory(path, error))
        fail(target, "written", EISDIR);
    // A rename would put a file in the place of a device or a pipe.
    if (fs::exists(path, error) && !fs::is_regular_file(path, error))
        throw Error(ErrorKind::file, target + ": cannot be written: it is not a regular file");
    remove_stale(path);
    temporary_ = folder_of(path)
                 / (prefix_of(path) + std::to_string(getpid()) + "." + std::to_string(count++)
                    + std::string(suffix));
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : target_(std::move(other.target_)),
      temporary_(std::move(other.temporary_)),
      exists_(std::exchange(other.exists_, false)) {}

AtomicFile::~AtomicFile() {
    if (exists_)
        unlink(temporary_.c_str());
}

void AtomicFile::write(const std::function<void(std::ostream&)>& fill) {
    errno = 0;
    std::ofstream stream(temporary_, std::ios::binary | std::ios::trunc);
    if (!stream)
        fail(target_, "written", errno);
    exists_ = true;
    int error = 0;
    try {
        stream.exceptions(std::ios::badbit | std::ios::failbit);
        errno = 0;
        fill(stream);
        stream.close();
        return;
    } catch (const std::ios_base::failure&) {
        error = errno;
    } catch (...) { // a library may wrap the stream's failure
        error = errno;
        if (stream.good())
            throw;
    }
    fail(target_, "written", error);
}

void AtomicFile::write(std::string_view bytes) {
    write([&](std::ostream& out) { out.write(bytes.data(), std::streamsize(bytes.size())); });
}

void AtomicFile::patch(uint64_t offset, std::string_view bytes) {
    const Descriptor file(open(temporary_.c_str(), O_WRONLY | O_CLOEXEC));
    while (!bytes.empty()) {
        const ssize_t written = pwrite(file.fd, bytes.data(), bytes.size(), off_t(offset));
        if (written < 0 && errno == EINTR)
            continue;
        if (written <= 0)
            fail(target_, "written", errno);
        offset += uint64_t(written);
        bytes.remove_prefix(size_t(written));
    }
}

uint64_t AtomicFile::seal() {
    const Descriptor file(open(temporary_.c_str(), O_WRONLY | O_CLOEXEC));
    struct stat status {};
    if (file.fd < 0 || fsync(file.fd) != 0 || fstat(file.fd, &status) != 0)
        fail(target_, "written", errno);
    return uint64_t(status.st_size);
}

void AtomicFile::publish() {
    if (together) {
        together->files_.push_back(std::move(*this));
        return;
    }
    if (rename(temporary_.c_str(), target_.c_str()) != 0)
        fail(target_, "written", errno);
    exists_ = false;
    const fs::path folder = folder_of(target_);
    const Descriptor directory(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    // Some file systems cannot sync folders (EINVAL), and some folders may be written, not read.
    if (directory.fd >= 0 && fsync(directory.fd) != 0 && errno != EINVAL)
        fail(target_, "written", errno);
}

PublishTogether::PublishTogether() {
    if (!together)
        together = this;
}

PublishTogether::~PublishTogether() {
    if (together == this)
        together = nullptr;
}

void PublishTogether::publish() {
    if (together != this)
        return;
    together = nullptr;
    for (AtomicFile& file : files_)
        file.publish();
    remove_files(removed_);
}

std::vector<WriteReport::File>
write_together(const std::vector<std::string>& names,
               const std::function<void(AtomicFile&, size_t)>& write) {
    std::deque<AtomicFile> files; // they do not move
    std::vector<WriteReport::File> written;
    for (const std::string& name : names) {
        files.emplace_back(name);
        written.push_back({name, 0});
    }
    tbb::parallel_for(size_t(0), files.size(), [&](size_t i) { write(files[i], i); });
    tbb::parallel_for(size_t(0), files.size(),
                      [&](size_t i) { written[i].bytes = files[i].seal(); });
    for (AtomicFile& file : files)
        file.publish();
    return written;
}

void remove_files(const std::vector<std::string>& names) {
    if (together) {
        together->removed_.insert(together->removed_.end(), names.begin(), names.end());
        return;
    }
    for (const std::string& name : names)
        unlink(name.c_str());
}

void reject(const std::string& path, const std::string& why) {
    throw Error(ErrorKind::invalid, path + ": " + why);
}

void refuse_pipes(const std::string& path, const std::string& name) {
    struct stat status {};
    if (stat(path.c_str(), &status) == 0 && !S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode))
        throw Error(ErrorKind::file, name + ": is not a file");
}

std::string read_file(const std::string& path, uint64_t max_bytes) {
    refuse_pipes(path, path);
    const Descriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
    struct stat status {};
    if (file.fd < 0 || fstat(file.fd, &status) != 0)
        fail(path, "read", errno);
    if (S_ISDIR(status.st_mode))
        fail(path, "read", EISDIR);
    if (uint64_t(status.st_size) > max_bytes)
        throw Error(ErrorKind::invalid, path + ": has " + std::to_string(status.st_size)
                                            + " bytes, more than the limit of "
                                            + std::to_string(max_bytes));
    std::string bytes(size_t(status.st_size), '\0');
    size_t have = 0;
    while (have < bytes.size()) {
        const ssize_t got = ::read(file.fd, bytes.data() + have, bytes.size() - have);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            fail(path, "read", errno);
        if (got == 0)
            break;
        have += size_t(got);
    }
    bytes.resize(have);
    return bytes;
}

} // namespace lpvbake::io
