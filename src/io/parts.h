// Parts of a volume, as shards of a bake leave them, and the volume that they make up.
//
// A part is an OpenVDB file of the layers of cells that a shard has baked, on a lattice of their
// own, canonical and in full precision. Its metadata are those of the whole bake, but for what only
// all of its cells tell, and besides
//
//     lpv:shard         "2/3": which of how many
//     lpv:shard_layers  "16,32": the layers [begin, end) along z that it has
//     lpv:shard_grid    "x,y,z,nx,ny,nz": origin and dims of the whole lattice
#pragma once

#include "io/format.h"
#include "lpvbake/progress.h"
#include "volume/grids.h"
#include "volume/slab.h"

#include <optional>
#include <string>
#include <vector>

namespace lpvbake::io {

/// "shard 2 of 3"
std::string text_of(volume::Shard shard);

/// Throws Error (invalid), which names `path`, where the shard in it and the one in another file
/// are no two of one whole.
void check_beside(const std::string& path, volume::Shard shard, const std::string& other_path,
                  volume::Shard other);

/// Writes the volume of the layers of a shard of `whole`, and gives it the metadata of a part.
/// Throws Error (file).
WriteReport write_part(const std::string& path, volume::Shard shard, volume::Slab layers,
                       const Grid& whole, Volume& volume);

/// Whether the volume of a file is a part, and of which shard.
std::optional<volume::Shard> shard_of(const Volume& volume);

/// All parts of a volume. Their values are read when they are asked for.
class Parts {
public:
    struct Part {
        std::string path, uuid;
        volume::Shard shard;
        volume::Slab layers;
    };

    /// Throws Error: file; invalid, which names the file and what is wrong: it is no part, is
    /// damaged, is of another bake than the first, comes twice, or which shard is missing.
    explicit Parts(const std::vector<std::string>& paths);

    /// Their lattice, order and metadata, without cells.
    const Volume& whole() const { return whole_; }
    /// Sets what only all cells tell.
    void set_metadata(const std::string& key, const std::string& value) {
        whole_.metadata[key] = value;
    }
    void erase_metadata(const std::string& key) { whole_.metadata.erase(key); }
    /// From the lowest layers up.
    const std::vector<Part>& parts() const { return parts_; }
    /// That they have, without values.
    const std::vector<volume::ConstGridView>& grids() const { return grids_; }
    /// All values, a step a grid. Throws as write_merged, and Error (memory).
    Volume read(Progress& progress) const;
    /// Those of the first grid of light, and the validity.
    Volume read_first_band() const;

private:
    void add(const std::string& path);
    void check_complete() const;

    Volume whole_;
    std::vector<volume::ConstGridView> grids_;
    std::vector<Part> parts_;
};

/// Writes them as one OpenVDB file, the same bytes as of a bake that was not parted. Grid after
/// grid is in memory; each is a step, or two where half precision is wanted. Throws Error: file;
/// invalid (a part was changed since).
WriteReport write_merged(const std::string& path, const Parts& parts, Precision precision,
                         Progress& progress);

} // namespace lpvbake::io
