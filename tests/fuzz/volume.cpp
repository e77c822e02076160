// What is made of a volume once OpenVDB has read it: metadata and grids of any kind and extent,
// then everything that reads a volume.
#include "fuzz.h"

#include "io/layout.h"
#include "io/slice.h"
#include "io/vdb_grids.h"
#include "volume/compare.h"
#include "volume/sampler.h"

#include <fuzzer/FuzzedDataProvider.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace lpvbake {
namespace {

constexpr volume::ShConvention conventions[] = {
    volume::ShConvention::radiance, volume::ShConvention::irradiance, volume::ShConvention::lpv,
    volume::ShConvention::godot,    volume::ShConvention::unity,      volume::ShConvention::unreal};
constexpr volume::Axes axes[] = {volume::Axes::gltf, volume::Axes::unity, volume::Axes::unreal,
                                 volume::Axes::blender};

using fuzz::require;

/// Small mostly, and sometimes anything.
int size_from(FuzzedDataProvider& data) {
    return data.ConsumeIntegralInRange(0, 15) ? data.ConsumeIntegralInRange(1, 4)
                                              : data.ConsumeIntegral<int>();
}

float value_from(FuzzedDataProvider& data) {
    return data.ConsumeIntegralInRange(0, 31) ? data.ConsumeFloatingPointInRange(-2.0f, 100.0f)
                                              : data.ConsumeFloatingPoint<float>();
}

template <class Grid>
openvdb::GridBase::Ptr grid_from(FuzzedDataProvider& data, glm::ivec3 dims) {
    using Value = typename Grid::ValueType;
    const auto next = [&] {
        if constexpr (std::is_same_v<Value, openvdb::Vec3s>)
            return Value(value_from(data), value_from(data), value_from(data));
        else
            return static_cast<Value>(value_from(data));
    };
    auto grid = Grid::create(next());
    for (int count = data.ConsumeIntegralInRange(0, 12); count > 0; --count) {
        const auto within = [&](int size) {
            return data.ConsumeIntegralInRange(0, std::clamp(size, 1, 8) - 1)
                   + (data.ConsumeIntegralInRange(0, 63) ? 0 : -1);
        };
        grid->tree().setValueOn({within(dims.x), within(dims.y), within(dims.z)}, next());
    }
    return grid;
}

/// A file's content: mostly what a volume has, each part now and then missing or of another kind.
io::VdbContent content_from(FuzzedDataProvider& data) {
    const auto odd = [&] { return data.ConsumeIntegralInRange(0, 31) == 31; };
    io::VdbContent content{std::make_shared<openvdb::MetaMap>(), {}, {}};
    openvdb::MetaMap& metadata = *content.metadata;
    const glm::ivec3 dims(size_from(data), size_from(data), size_from(data));
    const int order = data.ConsumeIntegralInRange(odd() ? -1 : 0, odd() ? 9 : 4);
    if (!odd())
        metadata.insertMeta("lpv:grid_dims", openvdb::Vec3IMetadata({dims.x, dims.y, dims.z}));
    metadata.insertMeta(
        "lpv:grid_origin",
        openvdb::Vec3DMetadata({data.ConsumeFloatingPointInRange(-1e3, 1e3),
                                odd() ? data.ConsumeFloatingPoint<double>() : 0.0, 0.0}));
    metadata.insertMeta("lpv:cell_size",
                        openvdb::DoubleMetadata(odd() ? data.ConsumeFloatingPoint<double>() : 0.5));
    if (odd())
        metadata.insertMeta("lpv:sh_order", openvdb::FloatMetadata(1.0f));
    else
        metadata.insertMeta("lpv:sh_order", openvdb::Int32Metadata(order));
    const volume::Encoding encoding{data.PickValueInArray(conventions),
                                    data.PickValueInArray(axes)};
    for (const auto& [key, value] : io::field_facts(encoding))
        metadata.insertMeta("lpv:" + key, openvdb::StringMetadata(odd() ? "else" : value));
    metadata.insertMeta("lpv:_" + data.ConsumeRandomLengthString(16),
                        openvdb::StringMetadata(data.ConsumeRandomLengthString(16)));

    std::map<std::string, openvdb::GridBase::Ptr> grids;
    const auto add = [&](const std::string& name, bool colour) {
        if (odd())
            return;
        grids[name] = colour != odd() ? grid_from<openvdb::Vec3SGrid>(data, dims)
                                      : grid_from<openvdb::FloatGrid>(data, dims);
        grids[name]->setName(name);
    };
    for (int k = 0; k < std::min((order + 1) * (order + 1), 25); ++k)
        add(std::string("sh_") + volume::coefficient_name(k), true);
    if (data.ConsumeBool())
        for (int k = 0; k < 4; ++k)
            add(std::string("occlusion_") + volume::coefficient_name(k), false);
    if (data.ConsumeBool())
        add("validity", false);
    for (int k = data.ConsumeIntegralInRange(0, 3); k-- > 0;)
        add("wall_" + std::to_string(k), true);
    if (odd())
        grids["validity"] = openvdb::BoolGrid::create();
    content.has = [grids](const std::string& name) { return grids.contains(name); };
    content.grid = [grids](const std::string& name) {
        const auto found = grids.find(name);
        return found == grids.end() ? nullptr : found->second;
    };
    return content;
}

void use(const Volume& volume, FuzzedDataProvider& data) {
    io::half_misfit(volume);
    fuzz::require(std::isfinite(volume::total_energy(volume)),
                  "the energy of a valid volume is finite");
    const glm::ivec3 dims = volume.grid.dims;
    const int sliced = data.ConsumeIntegralInRange(0, 2);
    if (std::max({dims.x, dims.y, dims.z}) < 64) {
        const float white = io::slice_scale(volume, sliced, dims[sliced] - 1).white;
        fuzz::require(std::isfinite(white) && white > 0, "white is above 0");
        if (data.ConsumeIntegralInRange(0, 15) == 0)
            io::slice_picture(volume, sliced, dims[sliced] - 1);
    }
    const glm::dvec3 point = volume.grid.center({0, 0, 0})
                             + volume.grid.cell
                                   * glm::dvec3(data.ConsumeFloatingPointInRange(-9.0, 9.0),
                                                data.ConsumeFloatingPointInRange(-9.0, 9.0), 0.25);
    for (const Reading reading : {Reading::trilinear, Reading::facing})
        for (int axis = 0; axis < 3; ++axis) {
            glm::dvec3 normal(0.0);
            normal[axis] = 1;
            const volume::CellWeights weights = volume::weights_at(volume, point, normal, reading);
            for (int i = 0; i < 8; ++i)
                fuzz::require(weights.weight[i] == 0 || weights.cell[i] < volume.grid.size(),
                              "weights belong to cells");
            read_irradiance(volume, point, normal, reading);
        }
    const volume::Comparison same = volume::compare(volume, volume, {{0.1}, 3});
    fuzz::require(same.identical && same.max == 0, "a volume is what it is");
    Volume other = volume;
    for (glm::vec3& value : other.sh[0])
        value *= 2.0f;
    fuzz::accepts([&] {
        volume::compare(other, volume, {{0.1}, 3});
        volume::difference(other, volume);
    });
}

} // namespace
} // namespace lpvbake

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
    using namespace lpvbake;
    static const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    FuzzedDataProvider data(bytes, size);
    const io::VdbContent content = content_from(data);
    if (const auto dims = content.metadata->getMetadata<openvdb::Vec3IMetadata>("lpv:grid_dims"))
        if (const openvdb::Vec3i d = dims->value();
            double(d.x()) * d.y() * d.z() > 1e5 && double(d.x()) * d.y() * d.z() < 1e12)
            return 0; // how much memory the machine has is not at stake here
    fuzz::accepts([&] {
        const Volume volume = io::volume_of(content, "file.vdb");
        io::check_volume(volume, "file.vdb", ErrorKind::invalid);
        use(volume, data);
    });
    return 0;
}
