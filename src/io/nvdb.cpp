// Everything that sees NanoVDB.
#include "io/nvdb.h"

#include "file_error.h"
#include "io/atomic_file.h"
#include "io/described.h"
#include "io/layout.h"
#include "io/vdb_grids.h"
#include "lpvbake/error.h"
#include "quoted.h"

#pragma GCC visibility push(default)
#include <nanovdb/util/GridChecksum.h>
#include <nanovdb/util/IO.h>
#include <nanovdb/util/OpenToNanoVDB.h>
#pragma GCC visibility pop
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>

namespace lpvbake::io {
namespace {

constexpr const char* format_name = "lpvbake grids";
constexpr const char* blind_name = "lpvbake";
constexpr size_t alignment = NANOVDB_DATA_ALIGNMENT;

/// What NanoVDB keeps a grid in: aligned as it wants it, and zero where it writes nothing.
class Buffer {
public:
    static Buffer create(uint64_t size, const Buffer* = nullptr) {
        Buffer buffer;
        buffer.blocks_.resize((size + alignment - 1) / alignment);
        buffer.size_ = size;
        return buffer;
    }
    uint8_t* data() { return reinterpret_cast<uint8_t*>(blocks_.data()); }
    const uint8_t* data() const { return reinterpret_cast<const uint8_t*>(blocks_.data()); }
    uint64_t size() const { return size_; }
    void clear() { *this = {}; }

private:
    struct alignas(alignment) Block {
        std::byte bytes[alignment]{};
    };
    std::vector<Block> blocks_;
    uint64_t size_ = 0;
};

using Handle = nanovdb::GridHandle<Buffer>;

// ---- writing ----

/// The grid with a text as blind data behind it, and the checksum of all.
template <class Value>
Handle with_blind_data(const Handle& grid, const std::string& text) {
    using BlindMetaData = nanovdb::GridBlindMetaData;
    const uint64_t end = grid.size() + sizeof(BlindMetaData);
    Handle handle(Buffer::create((end + text.size() + alignment) / alignment * alignment));
    std::memcpy(handle.data(), grid.data(), grid.size());
    auto* nano = handle.grid<Value>();
    nano->data()->mGridSize = handle.size();
    nano->data()->mBlindMetadataOffset = int64_t(grid.size());
    nano->data()->mBlindMetadataCount = 1;
    auto* blind = reinterpret_cast<BlindMetaData*>(handle.data() + grid.size());
    blind->setBlindData(handle.data() + end);
    blind->mElementCount = text.size();
    std::strcpy(blind->mName, blind_name);
    std::memcpy(handle.data() + end, text.data(), text.size());
    nanovdb::updateChecksum(*nano, nanovdb::ChecksumMode::Full);
    return handle;
}

template <class OpenGrid, class Value>
Handle convert(const openvdb::GridBase::Ptr& grid, const std::string& text) {
    return with_blind_data<Value>(nanovdb::openToNanoVDB<Buffer, typename OpenGrid::TreeType>(
                                      *openvdb::gridPtrCast<OpenGrid>(grid),
                                      nanovdb::StatsMode::Default, nanovdb::ChecksumMode::Disable,
                                      0),
                                  text);
}

std::string describe_grids(const Stored& stored, const std::vector<volume::ConstGridView>& views) {
    Json json = describe(format_name, stored, Precision::full);
    json["index_position"] = stored.encoding().corner_index ? "corner" : "center";
    for (const volume::ConstGridView& view : views) {
        const volume::Quantity quantity =
            volume::quantity_of(*view.kind, stored.encoding().convention);
        json["grids"][view.name()] = {{"quantity", quantity.name}, {"units", quantity.units}};
    }
    json["metadata"] = metadata_of(stored.volume());
    return text_of(json);
}

// ---- reading ----

/// A file's one segment: where its grids are. Nothing of it is believed that the size of the file
/// does not allow.
class Segment {
public:
    Segment(const std::string& path, const std::string& name) : path_(name) {
        refuse_pipes(path, name);
        errno = 0;
        file_.open(path, std::ios::binary | std::ios::ate);
        const std::streamoff end = file_ ? std::streamoff(file_.tellg()) : -1;
        if (end < 0 || end == std::numeric_limits<std::streamoff>::max()) {
            const int error = errno;
            throw Error(kind_of_file_error(error),
                        name + ": cannot be read: "
                            + (error ? std::strerror(error) : "input/output error"));
        }
        size_ = uint64_t(end);
        nanovdb::io::Header header;
        read(0, &header, sizeof header);
        if (header.magic != NANOVDB_MAGIC_NUMBER)
            reject(name, "is not a NanoVDB file");
        if (header.version.getMajor() != NANOVDB_MAJOR_VERSION_NUMBER
            || header.codec != nanovdb::io::Codec::NONE)
            reject(name, "is of another version of NanoVDB, or compressed, which lpvbake does not "
                         "write");
        uint64_t at = sizeof header;
        std::vector<std::pair<std::string, uint64_t>> sizes;
        for (int i = 0; i < header.gridCount; ++i) {
            nanovdb::io::MetaData meta;
            read(at, &meta, sizeof meta);
            if (meta.nameSize < 1 || meta.nameSize > nanovdb::GridData::MaxNameSize)
                reject(name, "names a grid in " + std::to_string(meta.nameSize) + " bytes");
            std::string grid(meta.nameSize, '\0');
            read(at + sizeof meta, grid.data(), grid.size());
            grid.resize(std::strlen(grid.c_str()));
            at += sizeof meta + meta.nameSize;
            sizes.emplace_back(grid, meta.gridSize);
        }
        for (const auto& [grid, bytes] : sizes) {
            if (bytes > size_ - at)
                reject(name, "ends within its grid " + printable(grid) + ": it is cut off");
            grids_.emplace(grid, std::pair(at, bytes));
            at += bytes;
        }
        if (grids_.empty())
            reject(name, "has no grids");
    }

    bool has(const std::string& grid) const { return grids_.contains(grid); }
    std::string first() const {
        return std::ranges::min_element(grids_, {}, [](auto& g) { return g.second.first; })->first;
    }
    Buffer load(const std::string& grid) {
        const auto [offset, bytes] = grids_.at(grid);
        Buffer buffer = Buffer::create(bytes);
        read(offset, buffer.data(), bytes);
        return buffer;
    }

private:
    void read(uint64_t offset, void* to, uint64_t size) {
        if (offset > size_ || size > size_ - offset)
            reject(path_, cut_off);
        file_.seekg(std::streamoff(offset));
        if (!file_.read(static_cast<char*>(to), std::streamsize(size)))
            throw Error(ErrorKind::file, path_ + ": cannot be read: input/output error");
    }

    std::ifstream file_;
    std::string path_;
    uint64_t size_ = 0;
    std::map<std::string, std::pair<uint64_t, uint64_t>> grids_; ///< offset and size in bytes
};

/// The bytes of a grid, of which any may be wrong. NanoVDB's own accessors follow its offsets
/// wherever they point to.
class Bytes {
public:
    Bytes(const Buffer& buffer, const std::string& name) : buffer_(buffer), name_(name) {}

    /// Throws Error (invalid) unless there is a whole Node there.
    template <class Node>
    const Node* at(uint64_t offset) const {
        if (offset % alignof(Node) != 0 || offset > buffer_.size()
            || sizeof(Node) > buffer_.size() - offset)
            reject(name_, "points to what is not there: it is damaged");
        return reinterpret_cast<const Node*>(buffer_.data() + offset);
    }
    std::string_view text(uint64_t offset, uint64_t size) const {
        if (offset > buffer_.size() || size > buffer_.size() - offset)
            reject(name_, "points to what is not there: it is damaged");
        return {reinterpret_cast<const char*>(buffer_.data()) + offset, size_t(size)};
    }
    const std::string& name() const { return name_; }

private:
    const Buffer& buffer_;
    const std::string& name_;
};

std::string description_in(const Bytes& bytes) {
    using BlindMetaData = nanovdb::GridBlindMetaData;
    const auto* grid = bytes.at<nanovdb::GridData>(0);
    for (uint64_t i = 0; i < std::min(grid->mBlindMetadataCount, 16u); ++i) {
        const uint64_t offset = uint64_t(grid->mBlindMetadataOffset) + i * sizeof(BlindMetaData);
        const auto* blind = bytes.at<BlindMetaData>(offset);
        if (std::strncmp(blind->mName, blind_name, sizeof blind->mName) == 0)
            return std::string(
                bytes.text(offset + uint64_t(blind->mByteOffset), blind->mElementCount));
    }
    reject(bytes.name(), "has no blind data \"lpvbake\": it is not of a volume of lpvbake; convert "
                         "its .vdb");
}

/// The values of a grid, in blocks of 8 x 8 x 8 cells.
template <class Value>
class Values {
public:
    explicit Values(const Bytes& bytes) : bytes_(bytes) {
        const auto* grid = bytes.at<nanovdb::GridData>(0);
        if (grid->mMagic != NANOVDB_MAGIC_NUMBER
            || grid->mGridType != nanovdb::mapToGridType<Value>())
            reject(bytes.name(), "has the wrong type");
        const uint64_t tree = sizeof *grid;
        root_ = tree + bytes.at<nanovdb::TreeData<3>>(tree)->mNodeOffset[3];
        const auto* root = bytes.at<Root>(root_);
        background_ = &root->mBackground;
        for (uint64_t i = 0; i < root->mTableSize; ++i) {
            const auto* tile = bytes.at<typename Root::Tile>(root_ + sizeof(Root)
                                                             + i * sizeof(typename Root::Tile));
            tiles_.emplace(tile->key, tile);
        }
    }

    /// The values of the block whose first cell is `first`, indexed by NanoLeaf::CoordToOffset, and
    /// false; or one for all, and true.
    std::pair<const Value*, bool> block(const nanovdb::Coord& first) const {
        const auto found = tiles_.find(Root::CoordToKey(first));
        if (found == tiles_.end())
            return {background_, true};
        if (!found->second->isChild())
            return {&found->second->value, true};
        const uint64_t upper = root_ + uint64_t(found->second->child);
        const auto [lower, tile] = child<nanovdb::NanoUpper<Value>>(upper, first);
        if (tile)
            return {tile, true};
        const auto [leaf, value] = child<nanovdb::NanoLower<Value>>(lower, first);
        if (value)
            return {value, true};
        return {bytes_.at<typename nanovdb::NanoLeaf<Value>::DataType>(leaf)->mValues, false};
    }

private:
    using Root = typename nanovdb::NanoRoot<Value>::DataType;

    /// Where the child of a node is in which a cell lies, or the value that the node has there.
    template <class Node>
    std::pair<uint64_t, const Value*> child(uint64_t offset, const nanovdb::Coord& cell) const {
        const auto* node = bytes_.at<typename Node::DataType>(offset);
        const uint32_t n = Node::CoordToOffset(cell);
        if (node->mChildMask.isOn(n))
            return {offset + uint64_t(node->mTable[n].child), nullptr};
        return {0, &node->mTable[n].value};
    }

    const Bytes& bytes_;
    uint64_t root_;
    const Value* background_;
    std::map<typename Root::KeyT, const typename Root::Tile*> tiles_;
};

template <class Value>
void copy_cells(const Bytes& bytes, const Grid& lattice, const volume::GridView& view) {
    const Values<Value> values(bytes);
    constexpr int side = 8;
    const glm::ivec3 dims = lattice.dims, blocks = (dims + side - 1) / side;
    const auto width = size_t(view.kind->width());
    tbb::parallel_for(0, blocks.z, [&](int bz) {
        for (int by = 0; by < blocks.y; ++by)
            for (int bx = 0; bx < blocks.x; ++bx) {
                const glm::ivec3 first(side * bx, side * by, side * bz),
                    last = glm::min(first + side, dims);
                const auto [from, is_uniform] = values.block({first.x, first.y, first.z});
                for (int z = first.z; z < last.z; ++z)
                    for (int y = first.y; y < last.y; ++y)
                        for (int x = first.x; x < last.x; ++x) {
                            const Value& value =
                                from[is_uniform
                                         ? 0
                                         : nanovdb::NanoLeaf<Value>::CoordToOffset({x, y, z})];
                            std::memcpy(view.data + width * lattice.index({x, y, z}), &value,
                                        sizeof value);
                        }
            }
    });
}

} // namespace

constexpr VolumeFormat nvdb_format{
    .extension = ".nvdb",
    .help = "NAME.nvdb",
    .write = [](const std::string& path, const Stored& stored, Precision precision,
                const Pictures&) { return write_nvdb(path, stored, precision); },
    .read = read_nvdb};

WriteReport write_nvdb(const std::string& path, const Stored& stored, Precision wanted) {
    initialise_vdb();
    WriteReport report;
    if (wanted != Precision::full)
        report.warnings.push_back(path
                                  + ": NanoVDB has no half of three floats; full precision was "
                                    "written instead");
    const std::vector<volume::ConstGridView> views = grids_to_write(stored);
    const std::vector<uint8_t> active = active_cells(stored.volume());
    const std::string description = describe_grids(stored, views);
    // The head comes first and is known last.
    nanovdb::io::Segment segment(nanovdb::io::Codec::NONE);
    uint64_t head = sizeof segment.header;
    for (const volume::ConstGridView& view : views)
        head += sizeof(nanovdb::io::MetaData) + view.name().size() + 1;
    AtomicFile file(path);
    file.write([&](std::ostream& out) {
        out << std::string(head, '\0');
        for (const volume::ConstGridView& view : views) {
            const openvdb::GridBase::Ptr grid = make_grid(view, stored, active);
            const Handle handle =
                view.kind->width() == 1
                    ? convert<openvdb::FloatGrid, float>(grid, description)
                    : convert<openvdb::Vec3SGrid, nanovdb::Vec3f>(grid, description);
            segment.add(handle);
            segment.meta.back().fileSize = handle.size();
            out.write(reinterpret_cast<const char*>(handle.data()), std::streamsize(handle.size()));
        }
    });
    std::ostringstream bytes;
    segment.write(bytes);
    file.patch(0, bytes.str());
    report.files = {{path, file.seal()}};
    file.publish();
    return report;
}

Volume read_nvdb(const std::string& path, volume::GridKinds kinds) {
    Segment segment(path, path);
    const Buffer first = segment.load(segment.first());
    const std::string description = description_in({first, path});
    Volume volume = read_description(path, description, [&](const Json& json) {
        Volume read = empty_volume(path, json, format_name, kinds);
        const volume::Encoding encoding = encoding_in(path, json);
        for (const GridKind* kind : kinds) {
            const int count = count_grids(
                read, *kind, [&](const std::string& name) { return segment.has(name); });
            make_grids(read, *kind, count, path);
            for (const volume::GridView& view : volume::grids_of(read, *kind)) {
                if (!segment.has(view.name()))
                    reject(path, "has no grid " + view.name());
                const Buffer buffer = segment.load(view.name());
                const std::string name = path + ": grid " + view.name();
                const Bytes bytes(buffer, name);
                if (kind->width() == 1)
                    copy_cells<float>(bytes, read.grid, view);
                else
                    copy_cells<nanovdb::Vec3f>(bytes, read.grid, view);
            }
        }
        io::decode(encoding, path, read);
        return read;
    });
    check_volume(volume, path, ErrorKind::invalid);
    return volume;
}

} // namespace lpvbake::io
