// Files that appear whole or not at all.
#include "io/atomic_file.h"

#include "io/io.h"
#include "unit/volumes.h"

#include <sys/resource.h>
#include <sys/wait.h>

#include <csignal>
#include <sys/stat.h>
#include <unistd.h>

using namespace lpvbake;

namespace {

/// Runs `act` in a child process and expects it to return true.
template <typename Act>
void in_child(const Act& act) {
    const pid_t child = fork();
    if (child == 0)
        _exit(act() ? 0 : 1);
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << "status " << status;
}

void write_whole(const std::string& path, const std::string& bytes) {
    io::AtomicFile file(path);
    file.write(bytes);
    EXPECT_EQ(file.seal(), bytes.size());
    file.publish();
}

} // namespace

TEST(AtomicFile, AppearsWhenPublished) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.txt";
    spill(path, "old");
    io::AtomicFile file(path);
    file.write("new!");
    EXPECT_EQ(slurp(path), "old");
    EXPECT_EQ(folder.count(), 2);
    file.patch(2, "WS");
    EXPECT_EQ(file.seal(), 4u);
    EXPECT_EQ(slurp(path), "old");
    file.publish();
    EXPECT_EQ(slurp(path), "neWS");
    EXPECT_EQ(folder.count(), 1);
}

TEST(AtomicFile, VanishesWhenAbandoned) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.txt";
    spill(path, "old");
    {
        io::AtomicFile file(path);
        file.write("new");
        EXPECT_EQ(std::filesystem::path(file.temporary()).filename().string()[0], '.');
        EXPECT_NE(file.temporary().find("." + std::to_string(getpid()) + "."), std::string::npos);
    }
    EXPECT_THROW(io::AtomicFile(path).write([](std::ostream&) { throw std::runtime_error("x"); }),
                 std::runtime_error);
    EXPECT_EQ(slurp(path), "old");
    EXPECT_EQ(folder.count(), 1);
}

TEST(AtomicFile, SeveralAppearTogetherOrNotAtAll) {
    const TemporaryFolder folder;
    write_whole(folder / "a", "old");
    write_whole(folder / "gone", "old");
    const auto write_all = [&](bool publish) {
        io::PublishTogether together;
        write_whole(folder / "a", "new");
        write_whole(folder / "b", "new");
        io::remove_files({folder / "gone"});
        EXPECT_EQ(slurp(folder / "a"), "old");
        EXPECT_EQ(slurp(folder / "gone"), "old");
        if (publish)
            together.publish();
    };
    write_all(false);
    EXPECT_EQ(slurp(folder / "a"), "old");
    EXPECT_EQ(folder.count(), 2) << "temporaries are gone";
    write_all(true);
    EXPECT_EQ(slurp(folder / "a"), "new");
    EXPECT_EQ(slurp(folder / "b"), "new");
    EXPECT_EQ(folder.count(), 2);
}

TEST(AtomicFile, KeepsSymbolicLinks) {
    const TemporaryFolder folder;
    spill(folder / "real", "old");
    std::filesystem::create_symlink("real", folder / "link");
    write_whole(folder / "link", "new");
    EXPECT_TRUE(std::filesystem::is_symlink(folder / "link"));
    EXPECT_EQ(slurp(folder / "real"), "new");
    EXPECT_EQ(folder.count(), 2);
}

TEST(AtomicFile, NamesMayBeAsLongAsTheyGet) {
    const TemporaryFolder folder;
    write_whole(folder / std::string(255, 'n'), "x");
    EXPECT_EQ(slurp(folder / std::string(255, 'n')), "x");
}

TEST(AtomicFile, RemovesWhatTheKilledLeftBehind) {
    const TemporaryFolder folder;
    const std::string path = folder / "a.txt";
    int ready[2];
    ASSERT_EQ(pipe(ready), 0);
    const pid_t child = fork();
    if (child == 0) {
        io::AtomicFile file(path);
        file.write("half done");
        const io::AtomicFile other(folder / "b.txt");
        const ssize_t told = ::write(ready[1], "x", 1);
        pause();
        _exit(told == 1 ? 0 : 1);
    }
    char byte;
    ASSERT_EQ(::read(ready[0], &byte, 1), 1);
    // Alive: left alone.
    write_whole(path, "first");
    EXPECT_EQ(folder.count(), 2);
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    EXPECT_EQ(slurp(path), "first");
    EXPECT_EQ(folder.count(), 2);
    // Another target does not care; its own does.
    write_whole(folder / "a.txt2", "x");
    EXPECT_EQ(folder.count(), 3);
    write_whole(path, "second");
    EXPECT_EQ(folder.count(), 2);
}

TEST(AtomicFile, FullDisk) {
    const TemporaryFolder folder;
    const Volume volume = random_volume({20, 20, 20}, 1, true, 1);
    for (const char* name : {"a.vdb", "a.exr", "a.json"})
        spill(folder / name, "old");
    // A limit on the size of files stands for the disk: writes end with an error half way.
    in_child([&] {
        signal(SIGXFSZ, SIG_IGN);
        const rlimit limit{10000, 10000};
        setrlimit(RLIMIT_FSIZE, &limit);
        for (const char* name : {"a.vdb", "a.exr"}) {
            const Error error = error_of(
                folder / "a", [&] { io::write_volume(folder / name, volume, Precision::full); });
            if (error.kind != ErrorKind::io
                || std::string(error.what()).find("File too large") == std::string::npos)
                return false;
        }
        return true;
    });
    EXPECT_EQ(folder.count(), 3);
    for (const char* name : {"a.vdb", "a.exr", "a.json"})
        EXPECT_EQ(slurp(folder / name), "old");
}

TEST(AtomicFile, FoldersThatRefuse) {
    const TemporaryFolder folder;
    const auto reason = [&](const std::string& path) {
        const Error error = error_of(path, [&] { write_whole(path, "x"); });
        EXPECT_EQ(error.kind, ErrorKind::file);
        return std::string(error.what());
    };
    EXPECT_NE(reason(folder / "none/a.vdb").find("No such file or directory"), std::string::npos);
    spill(folder / "file", "x");
    EXPECT_NE(reason(folder / "file/a.vdb").find("Not a directory"), std::string::npos);
    EXPECT_NE(reason(folder.path().string()).find("Is a directory"), std::string::npos);
    EXPECT_NE(reason("/proc/lpvbake.vdb").find("cannot be written"), std::string::npos);
    in_child([&] { // as root, permissions do not bind
        if (getuid() == 0 && setuid(65534) != 0)
            return false;
        chmod(folder.path().c_str(), 0555);
        return reason(folder / "a.vdb").find("Permission denied") != std::string::npos
               || getuid() == 0;
    });
    EXPECT_EQ(folder.count(), 1);
}

TEST(AtomicFile, ReadsWholeFiles) {
    const TemporaryFolder folder;
    spill(folder / "a", "12345");
    EXPECT_EQ(io::read_file(folder / "a", 5), "12345");
    EXPECT_EQ(error_of(folder / "a", [&] { io::read_file(folder / "a", 4); }).kind,
              ErrorKind::invalid);
    EXPECT_EQ(error_of(folder / "b", [&] { io::read_file(folder / "b", 4); }).kind,
              ErrorKind::file);
    EXPECT_EQ(error_of(folder / "", [&] { io::read_file(folder / "", 4); }).kind, ErrorKind::file);
    EXPECT_EQ(error_of("/dev/zero", [&] { io::read_file("/dev/zero", 4); }).kind, ErrorKind::file);
}
TEST(AtomicFile, LeavesDevicesAndPipesAlone) {
    const TemporaryFolder folder;
    const std::string pipe = folder / "pipe";
    ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
    std::filesystem::create_symlink("/dev/null", folder / "device");
    for (const std::string& target : {pipe, std::string(folder / "device")}) {
        try {
            io::AtomicFile file(target);
            ADD_FAILURE() << target;
        } catch (const Error& error) {
            EXPECT_EQ(error.kind, ErrorKind::file);
            EXPECT_NE(std::string(error.what()).find("regular file"), std::string::npos);
        }
    }
    EXPECT_TRUE(std::filesystem::is_fifo(pipe));
    EXPECT_TRUE(std::filesystem::is_character_file("/dev/null"));
}
