#include "bake/lit_file.h"

#include "io/atomic_file.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "surface/stored.h"

#include <array>

namespace lpvbake::bake {
namespace {

constexpr std::string_view magic("LPVLIT\0\1", 8); // a name and a version
constexpr uint64_t most_bytes = uint64_t(1) << 40;

struct Part {
    const char* name; ///< in messages
    std::string LitOrigin::*text;
};
constexpr std::array parts{Part{"another version of the program", &LitOrigin::version},
                           Part{"another scene", &LitOrigin::scene},
                           Part{"another instruction set for rays", &LitOrigin::tracer},
                           Part{"other settings", &LitOrigin::settings}};

void put(const std::string& text, cache::Writer& out) {
    out.put(std::vector<char>(text.begin(), text.end()));
}

bool get(cache::Reader& in, std::string& text) {
    std::vector<char> letters;
    if (!in.get(letters))
        return false;
    text.assign(letters.begin(), letters.end());
    return true;
}

} // namespace

WriteReport::File write_lit(const std::string& path, const LitOrigin& origin,
                            surface::LitSurfaces lit) {
    cache::Writer head, body;
    for (const Part& part : parts)
        put(origin.*part.text, head);
    surface::put(std::move(lit), body);
    head.put(cache::hash_of(body.bytes()));
    head.put(uint64_t(body.bytes().size()));
    io::AtomicFile file(path);
    file.write([&](std::ostream& out) {
        for (const std::string_view bytes :
             {magic, std::string_view(head.bytes()), std::string_view(body.bytes())})
            out.write(bytes.data(), std::streamsize(bytes.size()));
    });
    const uint64_t bytes = file.seal();
    file.publish();
    return {path, bytes};
}

surface::LitSurfaces read_lit(const std::string& path, const LitOrigin& origin, const Scene& scene,
                              const visibility::Visibility& visibility) {
    const std::string all = io::read_file(path, most_bytes);
    if (!all.starts_with(magic))
        io::reject(path, "is no file of lit surfaces of this version; lpvbake light writes one");
    cache::Reader in(std::string_view(all).substr(magic.size()));
    LitOrigin own;
    std::array<uint64_t, 2> hash{};
    uint64_t bytes = 0;
    bool whole = true;
    for (const Part& part : parts)
        whole = whole && get(in, own.*part.text);
    whole = whole && in.get(hash) && in.get(bytes) && bytes <= all.size();
    const std::string_view body = whole ? std::string_view(all).substr(all.size() - bytes) : "";
    if (!whole || cache::hash_of(body) != hash)
        io::reject(path, "is damaged or cut off; light the scene again");
    for (const Part& part : parts)
        if (own.*part.text != origin.*part.text)
            io::reject(path, std::string("is of ") + part.name + ": "
                                 + apart(own.*part.text, origin.*part.text)
                                 + "; light the scene again with the options of this bake");
    surface::LitSurfaces lit;
    cache::Reader values(body);
    if (!surface::get(values, scene, visibility, lit))
        io::reject(path, "does not fit the scene; light the scene again");
    return lit;
}

} // namespace lpvbake::bake
