// Volumes and folders for tests of files.
#pragma once

#include "lpvbake/error.h"
#include "volume/volume.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>

namespace lpvbake {

/// A folder of its own, removed at the end.
class TemporaryFolder {
public:
    TemporaryFolder() {
        std::string name = std::filesystem::temp_directory_path() / "lpvbake-XXXXXX";
        path_ = mkdtemp(name.data());
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    ~TemporaryFolder() { std::filesystem::remove_all(path_); }

    std::string operator/(const std::string& name) const { return path_ / name; }
    /// How many entries it has, hidden ones too.
    long count() const { return std::distance(std::filesystem::directory_iterator(path_), {}); }
    const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
};

inline void expect_equal(const Volume& a, const Volume& b) {
    EXPECT_EQ(a.grid, b.grid);
    EXPECT_EQ(a.sh_order, b.sh_order);
    EXPECT_EQ(a.sh, b.sh);
    EXPECT_EQ(a.occlusion, b.occlusion);
    EXPECT_EQ(a.validity, b.validity);
    EXPECT_EQ(a.walls, b.walls);
    EXPECT_EQ(a.metadata, b.metadata);
}

/// Cells of random light; a third of them outside (invalid) and black, all else random too.
inline Volume random_volume(glm::ivec3 dims, int order, bool occlusion, unsigned seed,
                            float scale = 1000) {
    std::mt19937 random(seed);
    std::normal_distribution<float> normal;
    Volume volume;
    volume.grid = {{-1.1, 2.3, 0.7}, 0.1, dims};
    volume.sh_order = order;
    const size_t n = volume.grid.size();
    volume.sh.assign(size_t((order + 1) * (order + 1)), std::vector<glm::vec3>(n));
    volume.occlusion.assign(occlusion ? 4 : 0, std::vector<float>(n));
    volume.validity.assign(n, 0);
    for (size_t i = 0; i < n; ++i) {
        if (random() % 3 == 0)
            continue;
        volume.validity[i] = float(random() % 4 != 0); // lit inside of geometry now and then
        for (auto& cells : volume.sh)
            cells[i] = scale * glm::vec3(normal(random), normal(random), normal(random));
        for (auto& cells : volume.occlusion)
            cells[i] = normal(random);
    }
    volume.walls.assign(2, std::vector<glm::vec3>(n));
    for (auto& cells : volume.walls)
        for (size_t i = 0; i < n; ++i)
            if (volume.validity[i] > 0)
                cells[i] = glm::vec3(normal(random), normal(random), normal(random));
    volume.metadata = {{"solver", "none"}, {"settings", "{\"a\": 1}"}, {"tool", "test"}};
    return volume;
}

inline std::string slurp(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
}

inline void spill(const std::string& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
}

/// Standard output and error of a shell command that must succeed.
inline std::string output_of(const std::string& command) {
    std::string text;
    FILE* pipe = popen((command + " 2>&1").c_str(), "r");
    for (char buffer[4096]; const size_t got = fread(buffer, 1, sizeof buffer, pipe);)
        text.append(buffer, got);
    EXPECT_EQ(pclose(pipe), 0) << command << '\n' << text;
    return text;
}

/// The Error that `act` throws; its text is one line that names `path`.
template <typename Act>
Error error_of(const std::string& path, const Act& act) {
    try {
        act();
    } catch (const Error& error) {
        const std::string text = error.what();
        EXPECT_EQ(text.find('\n'), std::string::npos) << text;
        EXPECT_NE(text.find(path), std::string::npos) << text;
        return error;
    }
    ADD_FAILURE() << "no error for " << path;
    return Error(ErrorKind::failure, "no error");
}

} // namespace lpvbake
