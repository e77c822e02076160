#include "failure.h"

#include "background.h"
#include "exit_code.h"
#include "lpvbake/error.h"
#include "options/wording.h"
#include "result.h"
#include "terminal.h"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <new>
#include <string>

namespace lpvbake::cmd {
namespace {

struct Failure {
    ErrorKind kind;
    std::string text;
};

Failure failure_of(const std::exception_ptr& thrown, const std::string& command) {
    try {
        std::rethrow_exception(thrown);
    } catch (const Error& error) {
        return {error.kind, error.what()};
    } catch (const std::bad_alloc&) {
        const bool has_grid = command == "bake" || command == "reference" || command == "report";
        return {ErrorKind::memory,
                has_grid ? "out of memory; a lower `resolution` needs less" : "out of memory"};
    } catch (const std::exception& error) {
        return {ErrorKind::failure, is_want_of_threads(error) ? want_of_threads : error.what()};
    } catch (...) {
        return {ErrorKind::failure, "something was thrown that is no exception"};
    }
}

/// The file that a text begins with, as "room.gltf: ..." or "room.toml:3: ..."; empty: none.
std::string file_of(const Failure& failure, const std::vector<std::string>& given) {
    const std::string& text = failure.text;
    const bool names_file = failure.kind == ErrorKind::file || failure.kind == ErrorKind::io;
    for (std::size_t end = text.find(':'); end != std::string::npos;
         end = text.find(':', end + 1)) {
        if (end + 1 == text.size()
            || (text[end + 1] != ' ' && !std::isdigit(static_cast<unsigned char>(text[end + 1]))))
            continue; // of a path, such as C:
        const std::string file = text.substr(0, end);
        std::error_code ignored;
        if (std::ranges::count(given, file) > 0 || names_file
            || std::filesystem::is_regular_file(file, ignored))
            return file;
    }
    return {};
}

} // namespace

int fail_by(const std::exception_ptr& thrown, const options::Asked& asked) {
    const Failure failure = failure_of(thrown, asked.command);
    const std::string text = on_one_line(options::in_options(failure.text));
    const ExitCodeMeaning& row = meaning_of(failure.kind);
    std::fprintf(stderr, "lpvbake: error: %s\n", text.c_str());
    tell_failure(text);
    if (asked.json && !is_json_printed()) {
        const std::string file = file_of(failure, asked.values);
        print_json({{"command",
                     asked.command.empty() ? report::Json(nullptr) : report::Json(asked.command)},
                    {"version", LPVBAKE_VERSION},
                    {"error",
                     {{"kind", row.name},
                      {"exit_code", int(row.code)},
                      {"message", text},
                      {"file", file.empty() ? report::Json(nullptr) : report::Json(file)},
                      {"retry", row.retry == Retry::again || row.retry == Retry::more_memory},
                      {"retry_how", retry_names[std::size_t(row.retry)]}}}});
        std::cout.flush(); // nothing else comes
    }
    return int(row.code);
}

} // namespace lpvbake::cmd
