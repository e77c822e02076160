#include "cache/cache.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <elf.h>
#include <gnu/libc-version.h>
#include <link.h>

namespace lpvbake::cache {
namespace {

/// The note in which linkers leave a hash of all that they linked; empty: there is none.
std::string build_id_in(const dl_phdr_info& object) {
    for (int i = 0; i < object.dlpi_phnum; ++i) {
        const ElfW(Phdr)& segment = object.dlpi_phdr[i];
        if (segment.p_type != PT_NOTE)
            continue;
        const auto* at = reinterpret_cast<const char*>(object.dlpi_addr + segment.p_vaddr);
        const char* end = at + segment.p_memsz;
        while (size_t(end - at) >= sizeof(ElfW(Nhdr))) {
            ElfW(Nhdr) note;
            std::memcpy(&note, at, sizeof note);
            const auto padded = [](size_t size) { return (size + 3) / 4 * 4; };
            const char* name = at + sizeof note;
            const char* bytes = name + padded(note.n_namesz);
            at = bytes + padded(note.n_descsz);
            if (at <= end && note.n_type == NT_GNU_BUILD_ID
                && std::string_view(name, note.n_namesz) == std::string_view("GNU", 4))
                return {bytes, note.n_descsz};
        }
    }
    return {};
}

/// Of the program or the library that this code is in.
std::string build_id() {
    std::string id;
    dl_iterate_phdr(
        [](dl_phdr_info* object, size_t, void* result) {
            const auto here = reinterpret_cast<ElfW(Addr)>(&program_id);
            for (int i = 0; i < object->dlpi_phnum; ++i) {
                const ElfW(Phdr)& segment = object->dlpi_phdr[i];
                const ElfW(Addr) begin = object->dlpi_addr + segment.p_vaddr;
                if (segment.p_type == PT_LOAD && here >= begin && here - begin < segment.p_memsz) {
                    *static_cast<std::string*>(result) = build_id_in(*object);
                    return 1;
                }
            }
            return 0;
        },
        &id);
    return id;
}

} // namespace

std::array<uint64_t, 2> hash_of(std::string_view bytes) {
    const XXH128_hash_t hash = XXH3_128bits(bytes.data(), bytes.size());
    return {hash.low64, hash.high64};
}

std::string program_id() {
    std::string id = LPVBAKE_VERSION " " + build_id() + " " + gnu_get_libc_version();
#if defined(__x86_64__)
    for (const bool has :
         {__builtin_cpu_supports("avx") != 0, __builtin_cpu_supports("avx2") != 0,
          __builtin_cpu_supports("fma") != 0, __builtin_cpu_supports("avx512f") != 0})
        id += has ? '1' : '0';
#endif
    return id;
}

Key Cache::key(std::string_view stage) const {
    Key key(stage);
    key.add_text(world_);
    return key;
}

bool Cache::get(const Key& key, const std::function<bool(Reader&)>& read) {
    if (const std::optional<std::string> value = load(key.bytes())) {
        Reader reader(*value);
        if (read(reader) && reader.at_end()) {
            ++counts_.reused;
            return true;
        }
        note_damaged(place_of(key.bytes()));
    }
    ++counts_.made;
    return false;
}

void Cache::put(const Key& key, const std::function<void(Writer&)>& write) {
    Writer writer;
    write(writer);
    store(key.bytes(), writer.bytes());
}

void Cache::note_damaged(const std::string& place) {
    note(place + ": is damaged, or of something else; what it held is made anew");
}

} // namespace lpvbake::cache
