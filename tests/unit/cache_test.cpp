// The cache as a folder: what is found in it is what was kept, whatever anybody does to its files.
#include "io/cache_folder.h"
#include "lpvbake/error.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <random>

#include <sys/stat.h>

namespace lpvbake {
namespace {

namespace fs = std::filesystem;

class CacheFolder : public testing::Test {
protected:
    CacheFolder()
        : folder_(fs::path(testing::TempDir())
                  / (std::string("cache_")
                     + testing::UnitTest::GetInstance()->current_test_info()->name())) {
        fs::remove_all(folder_);
    }
    ~CacheFolder() override { fs::remove_all(folder_); }

    static cache::Key key_of(const cache::Cache& cache, uint32_t number) {
        return cache.key("test").add(number);
    }
    static void put(cache::Cache& cache, uint32_t number, const std::vector<float>& values) {
        cache.put(key_of(cache, number), [&](cache::Writer& out) { out.put(values); });
    }
    static std::optional<std::vector<float>> get(cache::Cache& cache, uint32_t number) {
        std::vector<float> values;
        const bool there =
            cache.get(key_of(cache, number), [&](cache::Reader& in) { return in.get(values); });
        return there ? std::optional(values) : std::nullopt;
    }
    /// The files that hold values.
    std::vector<fs::path> files() const {
        std::vector<fs::path> found;
        for (const auto& entry : fs::directory_iterator(folder_))
            if (entry.path().extension() == ".lpvcache")
                found.push_back(entry.path());
        return found;
    }
    static std::string bytes_of(const fs::path& path) {
        std::ifstream file(path, std::ios::binary);
        return {std::istreambuf_iterator<char>(file), {}};
    }
    static void write(const fs::path& path, const std::string& bytes) {
        std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
    }

    const fs::path folder_;
    const std::vector<float> values_{1.0f, 2.0f, -3.5f};
};

TEST_F(CacheFolder, KeepsValuesByTheirKeys) {
    {
        io::CacheFolder cache(folder_, 1 << 20);
        EXPECT_FALSE(get(cache, 1));
        put(cache, 1, values_);
    }
    io::CacheFolder cache(folder_, 1 << 20);
    EXPECT_EQ(get(cache, 1), values_);
    EXPECT_FALSE(get(cache, 2));
    EXPECT_EQ(cache.counts().reused, 1u);
    EXPECT_EQ(cache.counts().made, 1u);
    cache.set_world(cache::Key("another world"));
    EXPECT_FALSE(get(cache, 1));
    EXPECT_TRUE(cache.take_notes().empty());
}

TEST_F(CacheFolder, FindsEveryDamage) {
    io::CacheFolder cache(folder_, 1 << 20);
    put(cache, 1, values_);
    ASSERT_EQ(files().size(), 1u);
    const fs::path path = files()[0];
    const std::string whole = bytes_of(path);
    const auto expect_refused = [&](const std::string& bytes, const std::string& what) {
        write(path, bytes);
        EXPECT_FALSE(get(cache, 1)) << what;
        const std::vector<std::string> notes = cache.take_notes();
        ASSERT_EQ(notes.size(), 1u) << what;
        EXPECT_NE(notes[0].find(path.string()), std::string::npos);
        EXPECT_EQ(notes[0].find('\n'), std::string::npos);
    };
    for (size_t i = 0; i < whole.size(); ++i) {
        expect_refused(whole.substr(0, i), "cut off at " + std::to_string(i));
        std::string changed = whole;
        for (const char bit : {'\1', '\x80'}) {
            changed[i] = char(whole[i] ^ bit);
            expect_refused(changed, "byte " + std::to_string(i));
        }
    }
    expect_refused(whole + '\0', "a byte too many");
    std::mt19937 random(5);
    for (int i = 0; i < 2000; ++i) {
        std::string noise = whole.substr(0, random() % whole.size());
        for (size_t k = random() % 64; k > 0; --k)
            noise += char(random());
        if (noise != whole)
            expect_refused(noise, "noise " + std::to_string(i));
    }
    // Another value under this name.
    put(cache, 2, values_);
    const fs::path other = files()[0] == path ? files()[1] : files()[0];
    expect_refused(bytes_of(other), "of another key");
    put(cache, 1, values_); // made anew
    EXPECT_EQ(get(cache, 1), values_);
}

TEST_F(CacheFolder, RefusesWhatIsNoSuchValue) {
    io::CacheFolder cache(folder_, 1 << 20);
    // Whole files whose lengths lie, and ones that go on.
    for (const uint64_t count : {uint64_t(4), uint64_t(1) << 62, ~uint64_t(0)}) {
        cache.put(key_of(cache, 1), [&](cache::Writer& out) {
            out.put(count);
            out.put(1.0f);
        });
        EXPECT_FALSE(get(cache, 1)) << count;
        EXPECT_EQ(cache.take_notes().size(), 1u);
    }
    cache.put(key_of(cache, 1), [&](cache::Writer& out) {
        out.put(values_);
        out.put(1.0f);
    });
    EXPECT_FALSE(get(cache, 1));
    EXPECT_EQ(cache.take_notes().size(), 1u);
}

TEST_F(CacheFolder, PutsUpWithWhatIsNoFile) {
    io::CacheFolder cache(folder_, 1 << 20);
    put(cache, 1, values_);
    const fs::path path = files()[0], victim = folder_ / "victim";
    fs::remove(path);
    ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
    EXPECT_FALSE(get(cache, 1)); // and does not wait
    put(cache, 1, values_);
    EXPECT_EQ(get(cache, 1), values_);
    // A link does not lead it to overwrite anything.
    write(victim, "mine");
    fs::remove(path);
    fs::create_symlink(victim, path);
    EXPECT_FALSE(get(cache, 1));
    put(cache, 1, values_);
    EXPECT_EQ(get(cache, 1), values_);
    EXPECT_EQ(bytes_of(victim), "mine");
    // A folder stays, and is told.
    fs::remove(path);
    fs::create_directories(path / "full");
    cache.take_notes();
    EXPECT_FALSE(get(cache, 1));
    put(cache, 1, values_);
    EXPECT_EQ(cache.take_notes().size(), 2u);
    EXPECT_TRUE(fs::exists(path / "full"));
}

TEST_F(CacheFolder, RemovesWhatWasNotUsedForTheLongestTime) {
    const std::vector<float> large(1000, 1.0f);
    io::CacheFolder cache(folder_, 9000); // two of them
    const auto age = [&](int minutes) {
        for (const fs::path& path : files())
            fs::last_write_time(path, fs::last_write_time(path) - std::chrono::minutes(minutes));
    };
    put(cache, 1, large);
    age(10);
    put(cache, 2, large);
    age(10);
    EXPECT_TRUE(get(cache, 1)); // now it is the younger one
    put(cache, 3, large);
    EXPECT_TRUE(get(cache, 1));
    EXPECT_FALSE(get(cache, 2));
    EXPECT_TRUE(get(cache, 3));
    put(cache, 4, std::vector<float>(3000, 1.0f)); // larger than all may be
    EXPECT_EQ(files().size(), 2u);
    // What a killed bake left.
    const fs::path left = folder_ / ".a.lpvcache.host.1.0.tmp",
                   young = folder_ / ".b.lpvcache.host.1.0.tmp", foreign = folder_ / "notes.txt";
    for (const fs::path& path : {left, young, foreign})
        write(path, "x");
    fs::last_write_time(left, fs::file_time_type::clock::now() - std::chrono::hours(2));
    put(cache, 5, large);
    EXPECT_FALSE(fs::exists(left));
    EXPECT_TRUE(fs::exists(young));
    EXPECT_TRUE(fs::exists(foreign));
}

TEST_F(CacheFolder, SaysWhereItCannotBe) {
    fs::create_directories(folder_);
    write(folder_ / "file", "x");
    for (const fs::path& path : {folder_ / "file", folder_ / "file" / "below"})
        try {
            const io::CacheFolder cache(path, 1 << 20);
            ADD_FAILURE() << path;
        } catch (const Error& error) {
            EXPECT_EQ(error.kind, ErrorKind::file);
            EXPECT_NE(std::string(error.what()).find(path.string()), std::string::npos);
        }
    // It is gone: one note, and no more.
    io::CacheFolder cache(folder_ / "gone", 1 << 20);
    fs::remove_all(folder_ / "gone");
    put(cache, 1, values_);
    put(cache, 2, values_);
    EXPECT_EQ(cache.take_notes().size(), 1u);
}

} // namespace
} // namespace lpvbake
