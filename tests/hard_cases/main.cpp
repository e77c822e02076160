// hard_cases DIR: writes the suite of hard cases, for `lpvbake report --suite DIR/suite.json`.
#include "hard_cases/hard_cases.h"

#include <cstdio>
#include <exception>
#include <filesystem>

int main(int count, char** arguments) {
    if (count != 2 || arguments[1][0] == '-') {
        std::fprintf(stderr, "usage: hard_cases DIR\n");
        return 1;
    }
    try {
        std::filesystem::create_directories(arguments[1]);
        lpvbake::scenes::write_hard_cases(arguments[1]);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "hard_cases: error: %s\n", error.what());
        return 2;
    }
}
