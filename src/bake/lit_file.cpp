#include "bake/lit_file.h"

#include "io/atomic_file.h"
#include "io/parts.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "surface/stored.h"
#include "text.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <span>

namespace lpvbake::bake {
namespace {

constexpr std::string_view magic("LPVLIT\0\2", 8); // a name and a version
constexpr uint64_t most_bytes = uint64_t(1) << 40;

struct Fact {
    const char* name; ///< in messages
    std::string LitOrigin::*text;
};
constexpr std::array facts{Fact{"another version of the program", &LitOrigin::version},
                           Fact{"another scene", &LitOrigin::scene},
                           Fact{"another instruction set or device for rays", &LitOrigin::tracer},
                           Fact{"other settings", &LitOrigin::settings}};

constexpr volume::Shard all{0, 0}; ///< as files of whole lit surfaces have it

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

WriteReport::File write(const std::string& path, const LitOrigin& origin, volume::Shard part,
                        const cache::Writer& body) {
    cache::Writer head;
    for (const Fact& fact : facts)
        put(origin.*fact.text, head);
    head.put(part);
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

/// A file that is whole, whatever it is of.
struct Opened {
    std::string path;
    std::string bytes;
    LitOrigin origin;
    volume::Shard part;
    std::size_t body = 0; ///< where it begins

    explicit Opened(const std::string& of);
    cache::Reader reader() const { return cache::Reader(std::string_view(bytes).substr(body)); }
    /// Throws Error (invalid) where it is of something else; the remedy is told.
    void check(const LitOrigin& other, const std::string& than, const std::string& remedy) const;
};

Opened::Opened(const std::string& of) : path(of), bytes(io::read_file(of, most_bytes)) {
    if (!std::string_view(bytes).starts_with(magic))
        io::reject(path, "is no file of lit surfaces of this version; lpvbake light writes one");
    cache::Reader in(std::string_view(bytes).substr(magic.size()));
    std::array<uint64_t, 2> hash{};
    uint64_t size = 0;
    bool whole = true;
    for (const Fact& fact : facts)
        whole = whole && get(in, origin.*fact.text);
    whole = whole && in.get(part) && in.get(hash) && in.get(size) && size <= bytes.size();
    body = whole ? bytes.size() - std::size_t(size) : 0;
    if (!whole || cache::hash_of(std::string_view(bytes).substr(body)) != hash
        || (part != all && (part.index < 1 || part.index > part.count)))
        io::reject(path, "is damaged or cut off; light the scene again");
}

void Opened::check(const LitOrigin& other, const std::string& than,
                   const std::string& remedy) const {
    for (const Fact& fact : facts)
        if (origin.*fact.text != other.*fact.text)
            io::reject(path, std::string("is of ") + fact.name + than + ": "
                                 + apart(origin.*fact.text, other.*fact.text) + "; " + remedy);
}

/// All parts, in their order.
std::vector<Opened> open_parts(const std::vector<std::string>& paths) {
    std::vector<Opened> parts;
    for (const std::string& path : paths) {
        const Opened& part = parts.emplace_back(path);
        if (part.part == all)
            io::reject(path, "is no part of lit surfaces, but all of them");
        const Opened& first = parts.front();
        part.check(first.origin, " than " + first.path, "light it again as the others were");
        for (const Opened& other : std::span(parts).first(parts.size() - 1))
            io::check_beside(path, part.part, other.path, other.part);
    }
    std::ranges::sort(parts, {}, [](const Opened& part) { return part.part.index; });
    for (volume::Shard wanted = {1, parts.front().part.count}; wanted.index <= wanted.count;
         ++wanted.index)
        if (const auto i = std::size_t(wanted.index - 1);
            i >= parts.size() || parts[i].part != wanted)
            throw Error(ErrorKind::invalid,
                        io::text_of(wanted)
                            + format(" of the lit surfaces is missing: light it with `shard` %d/%d",
                                     wanted.index, wanted.count));
    return parts;
}

} // namespace

WriteReport::File write_lit(const std::string& path, const LitOrigin& origin,
                            surface::LitSurfaces lit) {
    cache::Writer body;
    surface::put(std::move(lit), body);
    return write(path, origin, all, body);
}

WriteReport::File write_lit_part(const std::string& path, const LitOrigin& origin,
                                 surface::LitPart part) {
    const volume::Shard of{part.index, part.count};
    cache::Writer body;
    surface::put(std::move(part), body);
    return write(path, origin, of, body);
}

surface::LitSurfaces read_lit(const std::string& path, const LitOrigin& origin, const Scene& scene,
                              const visibility::Visibility& visibility) {
    const Opened file(path);
    file.check(origin, "", "light the scene again with the options of this bake");
    if (file.part != all)
        io::reject(path, "is " + io::text_of(file.part)
                             + " of lit surfaces; let lpvbake merge make one file of all");
    surface::LitSurfaces lit;
    cache::Reader values = file.reader();
    if (!surface::get(values, scene, visibility, lit))
        io::reject(path, "does not fit the scene; light the scene again");
    return lit;
}

bool is_lit(const std::string& path) {
    std::array<char, magic.size() - 1> bytes{};
    std::ifstream(path, std::ios::binary).read(bytes.data(), std::streamsize(bytes.size()));
    return magic.starts_with(std::string_view(bytes.data(), bytes.size()));
}

MergedLit merge_lit(const std::vector<std::string>& parts, const std::string& path,
                    Progress& progress) {
    std::vector<surface::LitPart> values;
    LitOrigin origin;
    {
        const std::vector<Opened> files = open_parts(parts);
        origin = files.front().origin;
        std::vector<cache::Reader> bodies;
        std::ranges::transform(files, std::back_inserter(bodies), &Opened::reader);
        if (!surface::get(bodies, values))
            io::reject(files.front().path, "does not fit the other parts; light the scene again");
    }
    surface::LitSurfaces lit = surface::join(std::move(values), progress);
    if (!surface::is_sound(lit)) // as of no scene of ours
        io::reject(parts.front(), "and the other parts hold light without bounds; light the scene "
                                  "again");
    const std::size_t patches = lit.patches.size();
    return {write_lit(path, origin, std::move(lit)), patches};
}

} // namespace lpvbake::bake
