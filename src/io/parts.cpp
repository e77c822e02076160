#include "io/parts.h"

#include "io/atomic_file.h"
#include "io/layout.h"
#include "io/vdb_grids.h"
#include "lpvbake/error.h"
#include "quoted.h"
#include "text.h"
#include "volume/grids.h"
#include "volume/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace lpvbake::io {
namespace {

constexpr const char* shard_key = "shard";
constexpr const char* layers_key = "shard_layers";
constexpr const char* grid_key = "shard_grid";

std::string text_of(volume::Slab layers) {
    return format("z %d to %d", layers.begin, layers.end - 1);
}

/// What another value of an entry of metadata means.
std::string what_differs(const std::string& key) {
    if (key == "tool")
        return "another version of the program";
    if (key == "scene_hash" || key == "bake_hash" || key == "scene")
        return "another scene";
    if (key == "tracer")
        return "another instruction set or device for rays";
    if (key == "device")
        return "another device";
    if (key == "settings" || key == "output_settings" || key == "choice")
        return "other settings";
    return "another " + key;
}

/// The order in which differences are told: causes before what follows from them.
constexpr std::array told_first{"tool", "scene_hash", "tracer", "device", "settings"};

void check_alike(const std::string& path, const std::string& first,
                 const std::map<std::string, std::string>& own,
                 const std::map<std::string, std::string>& other) {
    const auto value = [](const std::map<std::string, std::string>& of, const std::string& key) {
        const auto found = of.find(key);
        return found == of.end() ? std::string() : found->second;
    };
    const auto check = [&](const std::string& key) {
        if (value(own, key) == value(other, key))
            return;
        reject(path, "is of " + what_differs(key) + " than " + first + ": "
                         + apart(value(own, key), value(other, key))
                         + "; bake it again as the others were");
    };
    for (const char* key : told_first)
        check(key);
    for (const auto& [key, text] : own)
        check(key);
    for (const auto& [key, text] : other)
        check(key);
}

/// Takes an entry out of the metadata. Throws Error (invalid) where it is none.
template <class... Number>
void take(const std::string& path, Volume& volume, const char* key, const char* form,
          Number*... numbers) {
    const auto found = volume.metadata.find(key);
    int end = 0;
    if (found == volume.metadata.end()
        || std::sscanf(found->second.c_str(), form, numbers..., &end) != int(sizeof...(numbers))
        || std::size_t(end) != found->second.size())
        reject(path, format("is no part of a bake (its metadata have no right lpv:%s); "
                            "`shard` i/N writes one",
                            key));
    volume.metadata.erase(found);
}

} // namespace

std::string text_of(volume::Shard shard) {
    return format("shard %d of %d", shard.index, shard.count);
}

void check_beside(const std::string& path, volume::Shard shard, const std::string& other_path,
                  volume::Shard other) {
    if (path == other_path)
        reject(path, "is given twice; leave one of them out");
    if (shard.count != other.count)
        reject(path, "is " + text_of(shard) + ", and " + other_path + " is of "
                         + std::to_string(other.count)
                         + ": parts of one bake are of as many shards");
    if (shard.index == other.index)
        reject(path,
               "is " + text_of(shard) + ", and so is " + other_path + "; leave one of them out");
}

WriteReport write_part(const std::string& path, volume::Shard shard, volume::Slab layers,
                       const Grid& whole, Volume& volume) {
    const glm::dvec3 origin = whole.origin;
    const glm::ivec3 dims = whole.dims;
    volume.metadata[shard_key] = format("%d/%d", shard.index, shard.count);
    volume.metadata[layers_key] = format("%d,%d", layers.begin, layers.end);
    volume.metadata[grid_key] =
        format("%.17g,%.17g,%.17g,%d,%d,%d", origin.x, origin.y, origin.z, dims.x, dims.y, dims.z);
    return write_vdb(path, Stored(volume, {}, path), Precision::full);
}

std::optional<volume::Shard> shard_of(const Volume& volume) {
    const auto found = volume.metadata.find(shard_key);
    volume::Shard shard;
    if (found == volume.metadata.end()
        || std::sscanf(found->second.c_str(), "%d/%d", &shard.index, &shard.count) != 2)
        return {};
    return shard;
}

Parts::Parts(const std::vector<std::string>& paths) {
    for (const std::string& path : paths)
        add(path);
    std::ranges::sort(parts_, {}, [](const Part& part) { return part.shard.index; });
    check_complete();
}

void Parts::add(const std::string& path) {
    const OpenVdb file = open_vdb(path);
    const auto precision =
        file.content.metadata->getMetadata<openvdb::StringMetadata>("lpv:precision");
    Volume own = volume_of(file.content, path, {});
    Part part{path, file.uuid, {}, {}};
    Grid& grid = own.grid;
    const glm::ivec3 dims = grid.dims;
    take(path, own, shard_key, "%d/%d%n", &part.shard.index, &part.shard.count);
    take(path, own, layers_key, "%d,%d%n", &part.layers.begin, &part.layers.end);
    take(path, own, grid_key, "%lf,%lf,%lf,%d,%d,%d%n", &grid.origin.x, &grid.origin.y,
         &grid.origin.z, &grid.dims.x, &grid.dims.y, &grid.dims.z);
    check_dims(grid.dims, own.sh_order, {}, path);
    const volume::Shard shard = part.shard;
    if (shard.index < 1 || shard.index > shard.count || part.layers.begin < 0 || part.layers.end < 1
        || part.layers.end > grid.dims.z || dims.z > grid.dims.z
        || part.layers.begin != part.layers.end - dims.z || dims.x != grid.dims.x
        || dims.y != grid.dims.y || !std::isfinite(grid.origin.x + grid.origin.y + grid.origin.z)
        || !precision || precision->value() != name_of(Precision::full))
        reject(path, "is no part of a bake any more: it was changed since; bake it again");
    std::vector<volume::ConstGridView> grids = grids_in(file.content, own.sh_order);
    if (parts_.empty()) {
        whole_ = std::move(own);
        grids_ = std::move(grids);
    } else {
        const Part& first = parts_.front();
        check_alike(path, first.path, own.metadata, whole_.metadata);
        if (own.grid != whole_.grid || own.sh_order != whole_.sh_order
            || grids.size() != grids_.size())
            reject(path, "is of another grid than " + first.path);
        for (const Part& other : parts_)
            check_beside(path, shard, other.path, other.shard);
    }
    parts_.push_back(part);
}

void Parts::check_complete() const {
    const int count = parts_.front().shard.count;
    int layer = 0;
    for (int index = 1; index <= count; ++index) {
        const auto part =
            std::ranges::find(parts_, index, [](const Part& p) { return p.shard.index; });
        if (part == parts_.end()) {
            const auto next =
                std::ranges::find_if(parts_, [&](const Part& p) { return p.shard.index > index; });
            // Of several in a row that are missing only the first layer is known.
            const bool one = next == parts_.end() ? index == count : next->shard.index == index + 1;
            const int end = next == parts_.end() ? whole_.grid.dims.z : next->layers.begin;
            throw Error(ErrorKind::invalid,
                        text_of(volume::Shard{index, count})
                            + (one ? " (" + text_of(volume::Slab{layer, end}) + ")"
                                   : format(" (from z %d on)", layer))
                            + format(" is missing: bake it with `shard` %d/%d", index, count));
        }
        if (part->layers.begin != layer)
            reject(part->path, format("has the layers from %d on, not from %d on: it is of other "
                                      "shards than those before it; bake them again",
                                      part->layers.begin, layer));
        layer = part->layers.end;
    }
    if (layer != whole_.grid.dims.z)
        reject(parts_.back().path, "ends before the grid does: it is of other shards than those "
                                   "before it; bake them again");
}

namespace {

openvdb::GridBase::Ptr read_grid(const Parts::Part& part, const std::string& name) {
    openvdb::GridBase::Ptr grid = open_vdb(part.path, part.uuid).content.grid(name);
    if (!grid)
        reject(part.path, "has no grid " + name);
    return grid;
}

/// Reads all values of a grid.
void fill(const Parts& parts, const volume::GridView& view) {
    const auto width = std::size_t(view.kind->width());
    for (const Parts::Part& part : parts.parts()) {
        const Grid own = volume::grid_of(part.layers, parts.whole().grid);
        float* const first = view.data + width * volume::first_of(part.layers, parts.whole().grid);
        copy_grid(read_grid(part, view.name()), own, nullptr, part.path,
                  {view.kind, view.k, first, own.size()});
    }
}

/// A grid of all parts, as a file has it.
openvdb::GridBase::Ptr merged(const Parts& parts, const volume::ConstGridView& view, bool half) {
    const Volume& whole = parts.whole();
    const auto merge = [&]<class GridType>() -> openvdb::GridBase::Ptr {
        auto grid = GridType::create();
        auto accessor = grid->getAccessor();
        for (const Parts::Part& part : parts.parts()) {
            const auto from = openvdb::gridPtrCast<GridType>(read_grid(part, view.name()));
            if (!from)
                reject(part.path, "grid " + view.name() + " has the wrong type");
            check_within(*from, volume::grid_of(part.layers, whole.grid).dims, part.path);
            each_active(*from, [&](const openvdb::Coord& at, const auto& value) {
                accessor.setValueOn(at.offsetBy(0, 0, part.layers.begin), value);
            });
        }
        grid->tree().prune();
        return grid;
    };
    openvdb::GridBase::Ptr grid = view.kind->width() == 1 ? merge.operator()<openvdb::FloatGrid>()
                                                          : merge.operator()<openvdb::Vec3SGrid>();
    describe_grid(view.name(), whole.grid, false, view.kind == &density_kind, *grid);
    insert_facts(*view.kind, whole, {}, half, *grid);
    return grid;
}

/// Why the values should not be stored as half (io/layout.h).
std::optional<std::string> misfit_of(const Parts& parts, Progress& progress) {
    std::vector<float> values;
    uint64_t done = 0;
    for (const volume::ConstGridView& view : parts.grids()) {
        progress.advance(done++);
        const std::size_t cells = parts.whole().grid.size();
        values.resize(cells * std::size_t(view.kind->width()));
        if (view.kind == &density_kind)
            continue;
        fill(parts, {view.kind, view.k, values.data(), cells});
        if (auto why = half_misfit({view.kind, view.k, values.data(), cells}))
            return why;
    }
    return {};
}

} // namespace

Volume Parts::read(Progress& progress) const {
    Volume volume = whole_;
    progress.begin("read", grids_.size());
    uint64_t done = 0;
    for (const GridKind* kind : volume::grid_kinds()) {
        const auto count = std::ranges::count(grids_, kind, &volume::ConstGridView::kind);
        make_grids(volume, *kind, int(count), parts_.front().path);
        for (const volume::GridView& view : volume::grids_of(volume, *kind)) {
            progress.advance(done++);
            fill(*this, view);
        }
    }
    return volume;
}

Volume Parts::read_first_band() const {
    Volume volume = whole_;
    volume.sh_order = 0;
    for (const GridKind* kind : {&volume::light_kind(), &volume::kind_named("validity")}) {
        make_grids(volume, *kind, 1, parts_.front().path);
        for (const volume::GridView& view : volume::grids_of(volume, *kind))
            fill(*this, view);
    }
    return volume;
}

WriteReport write_merged(const std::string& path, const Parts& parts, Precision wanted,
                         Progress& progress) {
    initialise_vdb();
    const uint64_t grids = parts.grids().size(), looked = wanted == Precision::half ? grids : 0;
    progress.begin("merge", looked + grids);
    WriteReport report;
    report.precision = wanted;
    if (wanted == Precision::half)
        if (const auto why = misfit_of(parts, progress)) {
            report.precision = Precision::full;
            report.warnings.push_back(path + ": " + *why + "; full precision was written instead");
        }
    const bool half = report.precision == Precision::half;
    try {
        report.files.push_back(write_grids(path, file_metadata(parts.whole(), {}, half),
                                           parts.grids().size(), 1, [&](std::size_t i) {
                                               progress.advance(looked + i);
                                               return merged(parts, parts.grids()[i], half);
                                           }));
    } catch (const openvdb::Exception& error) {
        reject(parts.parts().front().path, one_line(error.what()));
    }
    return report;
}

} // namespace lpvbake::io
