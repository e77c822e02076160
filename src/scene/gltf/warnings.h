// What a loader has to say about a file that it reads all the same.
#pragma once

#include "lpvbake/error.h"

#include <map>
#include <string>
#include <vector>

namespace lpvbake::scene::gltf {

/// Lines of "file: place: what". Of one kind the first three places are named and the others
/// counted, so that a broken file of a million nodes does not bury what else there is to say.
class Warnings {
public:
    explicit Warnings(std::string file = "") : file_(std::move(file)) {}

    /// `kind` tells warnings apart that differ in their place and numbers alone.
    void add(const std::string& kind, const std::string& place, const std::string& what) {
        if (++count_of_[kind] <= shown)
            lines_.push_back(file_ + ": " + place + ": " + what);
    }

    /// The text of an error that is none, with what was done instead put before its remedy.
    void add(const std::string& kind, const Error& error, const std::string& done) {
        if (++count_of_[kind] > shown)
            return;
        std::string line = error.what();
        const size_t remedy = line.rfind("; ");
        line.insert(remedy == std::string::npos ? line.size() : remedy, ": " + done);
        lines_.push_back(line);
    }

    std::vector<std::string> lines() const {
        std::vector<std::string> all = lines_;
        for (const auto& [kind, count] : count_of_)
            if (count > shown)
                all.push_back(file_ + ": " + kind + ": " + std::to_string(count - shown)
                              + " more places of the kind");
        return all;
    }

private:
    static constexpr size_t shown = 3;

    std::string file_;
    std::vector<std::string> lines_;
    std::map<std::string, size_t> count_of_;
};

} // namespace lpvbake::scene::gltf
