// Everything that sees OpenVDB.
#include "io/vdb.h"

#include "background.h"
#include "file_error.h"
#include "io/atomic_file.h"
#include "io/layout.h"
#include "io/vdb_grids.h"
#include "volume/sh.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <functional>
#include <mutex>
#include <sstream>

namespace lpvbake::io {
namespace {

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::MetaMap;
using openvdb::Vec3SGrid;

// ---- the identity of a file ----

/// OpenVDB's header: magic (8 bytes), file version, library version major and minor (4 each), one
/// byte that tells of grid offsets, then the UUID as text.
constexpr uint64_t uuid_offset = 21, uuid_length = 36;

/// Two hashes of 64 bits, of words that are mixed in by multiplication (the primes of FNV-1a and of
/// Murmur 2): told apart are any two files that differ in one word, others all but surely.
class ContentHash {
public:
    void add(std::string_view bytes) {
        size_ += bytes.size();
        while (!bytes.empty()) {
            if (held_ > 0 || bytes.size() < sizeof word_) {
                const size_t more = std::min(sizeof word_ - held_, bytes.size());
                std::memcpy(reinterpret_cast<char*>(&word_) + held_, bytes.data(), more);
                held_ += more;
                bytes.remove_prefix(more);
                if (held_ == sizeof word_)
                    add_word();
                continue;
            }
            for (; bytes.size() >= sizeof word_; bytes.remove_prefix(sizeof word_)) {
                std::memcpy(&word_, bytes.data(), sizeof word_);
                add_word();
            }
        }
    }
    /// As a UUID of version 8 (RFC 9562, custom content).
    std::string uuid() {
        if (held_ > 0)
            add_word();
        const uint64_t high = (mix((a_ ^ size_) * 0x9e3779b97f4a7c15u) & ~0xf000ull) | 0x8000;
        const uint64_t low = mix((b_ ^ size_) * 0x9e3779b97f4a7c15u) << 2 >> 2 | 1ull << 63;
        std::string hex;
        for (uint64_t half : {high, low})
            for (int shift = 60; shift >= 0; shift -= 4)
                hex.push_back("0123456789abcdef"[half >> shift & 15]);
        for (size_t dash : {8u, 13u, 18u, 23u})
            hex.insert(dash, "-");
        return hex;
    }

private:
    void add_word() {
        a_ = mix((a_ ^ word_) * 0x100000001b3u);
        b_ = mix((b_ ^ word_) * 0xc6a4a7935bd1e995u);
        word_ = 0;
        held_ = 0;
    }
    static uint64_t mix(uint64_t x) { return x ^ x >> 31; }
    uint64_t size_ = 0;
    uint64_t word_ = 0; ///< not yet added, and so many bytes of it are known
    size_t held_ = 0;
    uint64_t a_ = 0xcbf29ce484222325u;
    uint64_t b_ = 0x9ae16a3b2f90404fu;
};

struct Identity {
    std::string stored;   ///< what stands in the header; empty if this is not an OpenVDB file
    std::string computed; ///< what write_vdb would have put there
};

/// Hashes a file but for its UUID. `name` is for errors.
Identity identify(const std::string& path, const std::string& name) {
    const auto fail = [&] {
        const int error = errno;
        throw Error(
            kind_of_file_error(error),
            name + ": cannot be read: " + (error ? std::strerror(error) : "input/output error"));
    };
    refuse_pipes(path, name);
    errno = 0;
    std::ifstream in(path, std::ios::binary);
    if (!in)
        fail();
    Identity identity;
    ContentHash hash;
    std::vector<char> chunk(1 << 20);
    for (bool first = true; in; first = false) {
        errno = 0;
        in.read(chunk.data(), std::streamsize(chunk.size()));
        const size_t got = size_t(in.gcount());
        if (in.bad() || (got == 0 && errno != 0)) // e.g. a folder opens, but does not read
            fail();
        if (first) {
            int64_t magic = 0;
            std::memcpy(&magic, chunk.data(), sizeof magic);
            if (got < uuid_offset + uuid_length || magic != openvdb::OPENVDB_MAGIC)
                return {};
            identity.stored.assign(&chunk[uuid_offset], uuid_length);
            std::memset(&chunk[uuid_offset], 0, uuid_length);
        }
        hash.add({chunk.data(), got});
    }
    identity.computed = hash.uuid();
    return identity;
}

// ---- writing ----

/// A file in memory. (A std::stringbuf copies all it holds each time it is asked.)
class Bytes : public std::streambuf {
public:
    std::string bytes;

protected:
    std::streamsize xsputn(const char* data, std::streamsize count) override {
        if (at_ != bytes.size())
            bytes.resize(std::max(bytes.size(), at_ + size_t(count)));
        if (at_ == bytes.size())
            bytes.append(data, size_t(count));
        else
            std::memcpy(bytes.data() + at_, data, size_t(count));
        at_ += size_t(count);
        return count;
    }
    int_type overflow(int_type c) override {
        const char one = traits_type::to_char_type(c);
        xsputn(&one, 1);
        return c;
    }
    pos_type seekoff(off_type by, std::ios_base::seekdir from, std::ios_base::openmode) override {
        const size_t start = from == std::ios_base::beg   ? 0
                             : from == std::ios_base::cur ? at_
                                                          : bytes.size();
        at_ = start + size_t(by);
        return pos_type(off_type(at_));
    }
    pos_type seekpos(pos_type to, std::ios_base::openmode mode) override {
        return seekoff(off_type(to), std::ios_base::beg, mode);
    }

private:
    size_t at_ = 0;
};

/// A grid that shares its tree with another, and whose leaves are written by all threads: a hundred
/// of them each, into memory, where they stay. In the stream they leave a gap of their size.
template <typename GridType>
class LeavesApart : public GridType {
public:
    LeavesApart(GridType& grid, std::vector<std::string>& pieces)
        : GridType(grid, openvdb::ShallowCopy{}),
          pieces_(pieces) {
        this->setTransform(grid.transformPtr()); // a copy of it is rounded anew
    }

    void writeBuffers(std::ostream& out) const override {
        using Leaf = typename GridType::TreeType::LeafNodeType;
        std::vector<const Leaf*> leaves;
        this->tree().getNodes(leaves); // in the order in which a tree writes them
        pieces_.resize((leaves.size() + leaves_a_piece - 1) / leaves_a_piece);
        tbb::parallel_for(size_t(0), pieces_.size(), [&](size_t piece) {
            const size_t begin = piece * leaves_a_piece,
                         end = std::min(leaves.size(), begin + leaves_a_piece);
            Bytes bytes;
            bytes.bytes.reserve((end - begin)
                                * (sizeof(Leaf) + Leaf::SIZE * sizeof(typename Leaf::ValueType)));
            std::ostream stream(&bytes);
            stream.copyfmt(out); // the file's settings: compression, and the background's place
            for (size_t i = begin; i < end; ++i)
                leaves[i]->writeBuffers(stream, this->saveFloatAsHalf());
            pieces_[piece].assign(bytes.bytes); // no larger than they are
        });
        size_t size = 0;
        for (const std::string& piece : pieces_)
            size += piece.size();
        out.seekp(std::streamoff(size), std::ios_base::cur);
    }

private:
    static constexpr size_t leaves_a_piece = 128;
    std::vector<std::string>& pieces_; ///< what the leaves are in the file
};

/// A grid as it stands in a file that begins with it.
struct PackedGrid {
    openvdb::io::GridDescriptor descriptor;
    size_t offsets_at = 0;           ///< where its descriptor's offsets stand
    std::string head;                ///< all but the leaves' values
    std::vector<std::string> leaves; ///< behind it
};

/// Writes grid after grid to any stream, with the offsets that let readers open single ones, as
/// io::Archive::write does with a list of them. (io::File does so too, but to a file of its own,
/// it does not see a full disk, and it compresses on one thread.) The UUID is left zero.
class GridStream : openvdb::io::Archive {
public:
    GridStream(std::ostream& out, const MetaMap& metadata, size_t grids) : out_(out) {
        Bytes header;
        auto settings = std::make_shared<openvdb::io::StreamMetadata>();
        std::ostream stream(&header);
        prepare(stream, settings);
        writeHeader(stream, /*seekable=*/true);
        metadata.writeMeta(stream);
        const auto count = int32_t(grids);
        stream.write(reinterpret_cast<const char*>(&count), sizeof count);
        header.bytes.replace(uuid_offset, uuid_length, uuid_length, '\0');
        place(header.bytes);
        put(header.bytes);
    }
    /// May be called by several threads at a time.
    PackedGrid pack(const openvdb::GridBase::Ptr& grid) const {
        if (const auto scalars = openvdb::gridPtrCast<FloatGrid>(grid))
            return pack(*scalars);
        if (const auto colours = openvdb::gridPtrCast<Vec3SGrid>(grid))
            return pack(*colours);
        throw std::invalid_argument("grid " + grid->getName() + " is of type " + grid->type());
    }
    /// Puts a grid behind those before it: its offsets, and what the UUID takes of its bytes. In
    /// the order of the file; may be called while another is written.
    PackedGrid place(PackedGrid packed) {
        openvdb::io::GridDescriptor& descriptor = packed.descriptor;
        descriptor.setGridPos(placed_ + descriptor.getGridPos());
        descriptor.setBlockPos(placed_ + descriptor.getBlockPos());
        descriptor.setEndPos(placed_ + descriptor.getEndPos());
        Bytes offsets;
        std::ostream stream(&offsets);
        descriptor.writeStreamPos(stream);
        packed.head.replace(packed.offsets_at, offsets.bytes.size(), offsets.bytes);
        place(packed.head);
        for (const std::string& piece : packed.leaves)
            place(piece);
        return packed;
    }
    /// What was placed, in the same order. Gives its memory back piece by piece.
    void send(PackedGrid packed) {
        put(packed.head);
        for (std::string& piece : packed.leaves) {
            put(piece);
            piece = {};
        }
    }
    /// What the UUID has to be, after the last grid.
    std::string uuid() { return hash_.uuid(); }

private:
    template <typename GridType>
    PackedGrid pack(GridType& grid) const {
        PackedGrid packed{{grid.getName(), grid.type(), grid.saveFloatAsHalf()}, 0, {}, {}};
        Bytes head;
        auto settings = std::make_shared<openvdb::io::StreamMetadata>();
        std::ostream stream(&head);
        packed.descriptor.writeHeader(stream);
        packed.offsets_at = head.bytes.size();
        stream.seekp(0);
        prepare(stream, settings);
        writeGrid(packed.descriptor, std::make_shared<LeavesApart<GridType>>(grid, packed.leaves),
                  stream,
                  /*seekable=*/true);
        packed.head = std::move(head.bytes);
        return packed;
    }
    /// `metadata` outlives the stream's use: it keeps where that stands.
    void prepare(std::ostream& out, openvdb::io::StreamMetadata::Ptr& metadata) const {
        openvdb::io::setStreamMetadataPtr(out, metadata, /*transfer=*/false);
        openvdb::io::setWriteGridStatsMetadata(out, isGridStatsMetadataEnabled());
        openvdb::io::setDataCompression(out, compression());
    }
    void place(std::string_view bytes) {
        hash_.add(bytes);
        placed_ += int64_t(bytes.size());
    }
    void put(std::string_view bytes) { out_.write(bytes.data(), std::streamsize(bytes.size())); }

    std::ostream& out_;
    ContentHash hash_;
    int64_t placed_ = 0;
};

void insert_text(MetaMap& metadata, const std::string& key, const std::string& value) {
    metadata.insertMeta("lpv:" + key, openvdb::StringMetadata(value));
}

} // namespace

void insert_lattice(const Volume& volume, const volume::Encoding& encoding, MetaMap& metadata,
                    const BrickPlaces* bricks) {
    const Grid& grid = bricks ? bricks->lattice : volume.grid;
    for (const auto& [key, value] : field_facts(encoding))
        insert_text(metadata, key, value);
    insert_text(metadata, "index_position", encoding.corner_index ? "corner" : "center");
    metadata.insertMeta("lpv:grid_dims",
                        openvdb::Vec3IMetadata({grid.dims.x, grid.dims.y, grid.dims.z}));
    metadata.insertMeta("lpv:grid_origin",
                        openvdb::Vec3DMetadata({grid.origin.x, grid.origin.y, grid.origin.z}));
    if (const glm::dquat& turn = grid.turn; grid.is_turned())
        metadata.insertMeta("lpv:grid_turn",
                            openvdb::Vec4DMetadata({turn.x, turn.y, turn.z, turn.w}));
    metadata.insertMeta("lpv:cell_size", openvdb::DoubleMetadata(grid.cell));
    metadata.insertMeta("lpv:sh_order", openvdb::Int32Metadata(volume.sh_order));
}

void insert_facts(const GridKind& kind, const Volume& volume, const volume::Encoding& encoding,
                  bool half, openvdb::GridBase& grid, const BrickPlaces* bricks) {
    const volume::Quantity quantity = volume::quantity_of(kind, encoding.convention);
    grid.setSaveFloatAsHalf(half);
    insert_lattice(volume, encoding, grid, bricks);
    insert_text(grid, "quantity", quantity.name);
    insert_text(grid, "units", quantity.units);
}

MetaMap file_metadata(const Volume& volume, const volume::Encoding& encoding, bool half,
                      const BrickPlaces* bricks) {
    MetaMap metadata;
    insert_text(metadata, "tool", "lpvbake " LPVBAKE_VERSION);
    for (const auto& [key, value] : volume.metadata)
        insert_text(metadata, key, value);
    insert_text(metadata, "precision", half ? "half" : "float");
    insert_lattice(volume, encoding, metadata, bricks);
    return metadata;
}

WriteReport::File write_grids(const std::string& path, const MetaMap& metadata, size_t count,
                              size_t at_once,
                              const std::function<openvdb::GridBase::Ptr(size_t)>& make) {
    AtomicFile file(path);
    std::string uuid;
    file.write([&](std::ostream& out) {
        GridStream stream(out, metadata, count);
        size_t next = 0;
        const auto number = [&](tbb::flow_control& control) {
            if (next == count)
                control.stop();
            return next++;
        };
        using tbb::filter_mode;
        tbb::parallel_pipeline(
            at_once, tbb::make_filter<void, size_t>(filter_mode::serial_in_order, number)
                         & tbb::make_filter<size_t, PackedGrid>(
                             filter_mode::parallel, [&](size_t i) { return stream.pack(make(i)); })
                         & tbb::make_filter<PackedGrid, PackedGrid>(
                             filter_mode::serial_in_order,
                             [&](PackedGrid packed) { return stream.place(std::move(packed)); })
                         & tbb::make_filter<PackedGrid, void>(
                             filter_mode::serial_in_order,
                             [&](PackedGrid packed) { stream.send(std::move(packed)); }));
        uuid = stream.uuid();
    });
    file.patch(uuid_offset, uuid);
    WriteReport::File written{path, file.seal()};
    file.publish();
    return written;
}

namespace {

/// Grids that are made and compressed at a time: what fits 2 GiB, one at least.
size_t grids_at_once(const Grid& lattice) {
    constexpr uint64_t cell = sizeof(openvdb::Vec3s) + sizeof(openvdb::Vec3s); // tree and bytes
    const uint64_t fit = (uint64_t(2) << 30) / (cell * lattice.size() + 1);
    return size_t(std::clamp<uint64_t>(fit, 1, uint64_t(threads_at_work())));
}

// ---- reading ----

template <typename Value>
Value required(const MetaMap& metadata, const char* key, const std::string& path) {
    const auto found = metadata.getMetadata<openvdb::TypedMetadata<Value>>(key);
    if (!found)
        reject(path, std::string("has no metadata ") + key + ": not a volume of lpvbake");
    return found->value();
}

/// Copies a grid's active values into cells; those without stay as they are. convert(value, cell)
/// puts a value where the cell's floats begin. Of bricks the cells are those of their stack.
template <typename GridType, typename Convert>
void copy_cells(const openvdb::GridBase::Ptr& base, const Grid& cells, const BrickPlaces* bricks,
                const std::string& path, const volume::GridView& view, const Convert& convert) {
    const auto grid = openvdb::gridPtrCast<GridType>(base);
    if (!grid)
        reject(path, "grid " + base->getName() + " has the wrong type, " + base->type());
    check_within(*grid, (bricks ? bricks->lattice : cells).dims, path);
    const int width = view.kind->width();
    tbb::parallel_for(0, cells.dims.z, [&](int z) {
        const auto accessor = grid->getConstAccessor();
        float* cell = view.data + cells.index({0, 0, z}) * size_t(width);
        for (int y = 0; y < cells.dims.y; ++y)
            for (int x = 0; x < cells.dims.x; ++x, cell += width) {
                const glm::ivec3 own(x, y, z);
                if (const auto at = bricks ? bricks->of_cell(own) : std::optional(own))
                    convert(accessor.getValue(Coord(at->x, at->y, at->z)), cell);
            }
    });
}

} // namespace

void copy_grid(const openvdb::GridBase::Ptr& base, const Grid& lattice, const BrickPlaces* bricks,
               const std::string& path, const volume::GridView& view) {
    if (view.kind->width() == 1)
        copy_cells<FloatGrid>(base, lattice, bricks, path, view,
                              [](float value, float* cell) { *cell = value; });
    else
        copy_cells<Vec3SGrid>(base, lattice, bricks, path, view,
                              [](const openvdb::Vec3s& value, float* cell) {
                                  std::copy_n(value.asPointer(), 3, cell);
                              });
}

Volume volume_of(const VdbContent& content, const std::string& path, volume::GridKinds kinds,
                 const BrickPlaces* bricks) {
    Volume volume;
    const MetaMap::Ptr& metadata = content.metadata;
    const auto dims = required<openvdb::Vec3i>(*metadata, "lpv:grid_dims", path);
    const auto origin = required<openvdb::Vec3d>(*metadata, "lpv:grid_origin", path);
    volume.grid = {{origin.x(), origin.y(), origin.z()},
                   required<double>(*metadata, "lpv:cell_size", path),
                   {dims.x(), dims.y(), dims.z()}};
    if ((*metadata)["lpv:grid_turn"]) {
        const auto turn = required<openvdb::Vec4d>(*metadata, "lpv:grid_turn", path);
        volume.grid.turn = glm::dquat(turn.w(), turn.x(), turn.y(), turn.z());
    }
    if (bricks) {
        const Grid& listed = bricks->lattice;
        if (listed.dims != volume.grid.dims
            || !(glm::length(listed.origin - volume.grid.origin) < 1e-3 * listed.cell)
            || !(std::abs(listed.cell - volume.grid.cell) < 1e-6 * listed.cell))
            reject(path, "has another lattice than its manifest lists: of another bake; bake all "
                         "levels together");
        volume.grid = {{}, 1, volume::BrickStack(bricks->first.size()).dims()};
    }
    volume.sh_order = required<int32_t>(*metadata, "lpv:sh_order", path);
    if (volume.sh_order < 0 || volume.sh_order > volume::sh_max_order)
        reject(path, "lpv:sh_order is " + std::to_string(volume.sh_order) + ", not 0 to "
                         + std::to_string(volume::sh_max_order));
    check_dims(volume.grid.dims, volume.sh_order, kinds, path);
    const volume::Encoding encoding = encoding_of(
        [&](const char* key) {
            return required<std::string>(*metadata, (std::string("lpv:") + key).c_str(), path);
        },
        path);
    if (bricks && encoding.axes != volume::Axes::gltf)
        reject(path, "has turned axes, which bricks have not; bake them again");

    for (const GridKind* kind : kinds) {
        int count = kind == &volume::light_kind() ? volume::sh_count(volume.sh_order) : 0;
        if (count == 0 && content.has(volume::grid_name(*kind, 0)))
            for (count = kind->fewest;
                 count < kind->most && content.has(volume::grid_name(*kind, count));)
                ++count;
        make_grids(volume, *kind, count, path);
        for (const volume::GridView& view : volume::grids_of(volume, *kind)) {
            const openvdb::GridBase::Ptr found = content.grid(view.name());
            if (!found)
                reject(path, "has no grid " + view.name());
            copy_grid(found, volume.grid, bricks, path, view);
        }
    }

    MetaMap ours;
    insert_lattice(volume, encoding, ours);
    insert_text(ours, "precision", "");
    for (auto entry = metadata->beginMeta(); entry != metadata->endMeta(); ++entry)
        if (entry->first.starts_with("lpv:") && !ours[entry->first])
            volume.metadata[entry->first.substr(4)] = entry->second->str();
    decode(encoding, path, volume);
    return volume;
}

constexpr VolumeFormat vdb_format{
    .extension = ".vdb",
    .help = "NAME.vdb",
    .write = [](const std::string& path, const Stored& stored, Precision precision,
                const Pictures&) { return write_vdb(path, stored, precision); },
    .read = [](const std::string& path, volume::GridKinds kinds) { return read_vdb(path, kinds); }};

WriteReport write_vdb(const std::string& path, const Stored& stored, Precision wanted,
                      const BrickPlaces* bricks) {
    initialise_vdb();
    const Volume& volume = stored.volume();
    const volume::Encoding& encoding = stored.encoding();
    WriteReport report;
    const bool half = stored.precision(wanted, path, report) == Precision::half;
    const std::vector<uint8_t> active = active_cells(volume);
    const auto make = [&](const volume::ConstGridView& view) {
        const openvdb::GridBase::Ptr grid = make_grid(view, stored, active, bricks);
        insert_facts(*view.kind, volume, encoding, half, *grid, bricks);
        return grid;
    };
    const std::vector<volume::ConstGridView> views = grids_to_write(stored);
    report.files.push_back(write_grids(path, file_metadata(volume, encoding, half, bricks),
                                       views.size(), grids_at_once(volume.grid),
                                       [&](size_t i) { return make(views[i]); }));
    return report;
}

std::string one_line(std::string text) {
    std::replace(text.begin(), text.end(), '\n', ' ');
    return text;
}

OpenVdb open_vdb(const std::string& path, const std::string& known) {
    initialise_vdb();
    // OpenVDB trusts what it reads, so damage has to be found before.
    if (known.empty()) {
        const Identity identity = identify(path, path);
        if (identity.stored.empty())
            reject(path, "is not an OpenVDB file, or is cut off");
        if (identity.stored != identity.computed)
            reject(path,
                   "is damaged, or was not written by lpvbake: its UUID does not fit its content");
    }
    try {
        const auto file = std::make_shared<openvdb::io::File>(path);
        file->open(/*delayLoad=*/false);
        if (!known.empty() && file->getUniqueTag() != known)
            reject(path, "was written anew while it was read");
        return {{file->getMetadata(),
                 [file](const std::string& name) { return file->hasGrid(name); },
                 [file](const std::string& name) {
                     return file->hasGrid(name) ? file->readGrid(name) : nullptr;
                 }},
                file->getUniqueTag()};
    } catch (const openvdb::Exception& error) {
        reject(path, one_line(error.what()));
    }
}

namespace {

Volume read(const std::string& path, volume::GridKinds kinds, const BrickPlaces* bricks) {
    const OpenVdb file = open_vdb(path);
    Volume volume;
    try {
        volume = volume_of(file.content, path, kinds, bricks);
    } catch (const openvdb::Exception& error) {
        reject(path, one_line(error.what()));
    }
    check_volume(volume, path, ErrorKind::invalid);
    return volume;
}

} // namespace

Volume read_vdb(const std::string& path, volume::GridKinds kinds) {
    return read(path, kinds, nullptr);
}

Volume read_vdb(const std::string& path, const BrickPlaces& bricks) {
    return read(path, volume::grid_kinds(), &bricks);
}

} // namespace lpvbake::io
