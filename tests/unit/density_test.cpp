// Densities of other programs' OpenVDB files: what is read of them, and what is refused.
#include "io/density.h"

#include "io/vdb_grids.h"
#include "lpvbake/error.h"
#include "unit/volumes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>

namespace lpvbake {
namespace {

class Density : public ::testing::Test {
protected:
    void SetUp() override { io::initialise_vdb(); }

    static openvdb::FloatGrid::Ptr grid(const char* name = "density") {
        auto made = openvdb::FloatGrid::create(0.0f);
        made->setName(name);
        return made;
    }
    std::string write(const openvdb::GridPtrVec& grids) {
        const std::string path = folder_ / "smoke.vdb";
        openvdb::io::File(path).write(grids);
        return path;
    }
    void expect_refused(const openvdb::GridPtrVec& grids, ErrorKind kind, const std::string& part,
                        const std::string& name = "") {
        const std::string path = write(grids);
        try {
            (void)io::read_density(path, name, warnings_);
            ADD_FAILURE() << part;
        } catch (const Error& error) {
            EXPECT_EQ(error.kind, kind) << error.what();
            EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
            EXPECT_TRUE(std::string(error.what()).starts_with(path));
        }
    }

    TemporaryFolder folder_;
    std::vector<std::string> warnings_;
};

TEST_F(Density, IsReadOnAnyTransform) {
    // Turned, of edges 0.5, 2 and 1, mirrored, somewhere else.
    openvdb::Mat4d map = openvdb::Mat4d::identity();
    map.postScale(openvdb::Vec3d(0.5, -2, 1));
    map.postRotate(openvdb::math::Z_AXIS, 0.7);
    map.postTranslate(openvdb::Vec3d(10, 20, -30));
    const auto smoke = grid();
    smoke->setTransform(openvdb::math::Transform::createLinearTransform(map));
    smoke->tree().setValue({-5, 100, 7}, 0.25f);
    smoke->tree().setValue({-3, 102, 9}, 4.0f);
    smoke->fill(openvdb::CoordBBox({-4, 100, 7}, {-4, 101, 8}), 2.0f);
    const volume::Density density = io::read_density(write({smoke, grid("heat")}), "", warnings_);
    EXPECT_EQ(density.dims, glm::ivec3(3));
    EXPECT_EQ(density.most, 4.0f);
    EXPECT_TRUE(warnings_.empty());
    const auto at = [&](double x, double y, double z) {
        const openvdb::Vec3d world = smoke->indexToWorld(openvdb::Vec3d(x, y, z));
        return density.at(
            glm::dvec3(density.to_voxels * glm::dvec4(world.x(), world.y(), world.z(), 1)));
    };
    EXPECT_EQ(at(-5, 100, 7), 0.25);
    EXPECT_EQ(at(-5.49, 100.49, 6.51), 0.25);
    EXPECT_EQ(at(-4, 101, 8), 2);
    EXPECT_EQ(at(-3, 102, 9), 4);
    EXPECT_EQ(at(-2.51, 102.49, 9.49), 4);
    EXPECT_EQ(at(-2.49, 102, 9), 0); // outside
    EXPECT_EQ(at(-3, 100, 7), 0);    // not active
    EXPECT_EQ(at(1e12, 0, 0), 0);
}

TEST_F(Density, GoesByName) {
    const auto a = grid("smoke"), b = grid("fire");
    a->tree().setValue({0, 0, 0}, 1.0f);
    b->tree().setValue({0, 0, 0}, 2.0f);
    EXPECT_EQ(io::read_density(write({a, b}), "fire", warnings_).most, 2.0f);
    EXPECT_EQ(io::read_density(write({a}), "", warnings_).most, 1.0f);
    expect_refused({a, b}, ErrorKind::invalid, "which grid is the density?");
    expect_refused({a, b}, ErrorKind::invalid, "has no grid \"steam\"; there are", "steam");
}

TEST_F(Density, RefusesOrClampsWhatIsNone) {
    const auto with = [&](float value) {
        const auto made = grid();
        made->tree().setValue({3, 4, 5}, 1.0f);
        made->tree().setValue({4, 4, 5}, value);
        return made;
    };
    expect_refused({with(std::numeric_limits<float>::quiet_NaN())}, ErrorKind::invalid,
                   "grid \"density\": voxel (4, 4, 5) is not finite");
    expect_refused({with(HUGE_VALF)}, ErrorKind::invalid, "voxel (4, 4, 5) is not finite");
    EXPECT_EQ(io::read_density(write({with(-2)}), "", warnings_).values[1], 0.0f);
    ASSERT_EQ(warnings_.size(), 1u);
    EXPECT_NE(warnings_[0].find("1 voxel below 0 count as 0"), std::string::npos);

    expect_refused({grid()}, ErrorKind::invalid, "has no active voxel");
    const auto zero = grid();
    zero->fill(openvdb::CoordBBox({0, 0, 0}, {2, 2, 2}), 0.0f);
    expect_refused({zero}, ErrorKind::invalid, "has no voxel above 0");
    const auto vectors = openvdb::Vec3SGrid::create();
    vectors->setName("density");
    vectors->tree().setValue({0, 0, 0}, openvdb::Vec3s(1.0f));
    expect_refused({vectors}, ErrorKind::unsupported, "holds vec3s, not float");
    const auto distances = with(1);
    distances->setGridClass(openvdb::GRID_LEVEL_SET);
    expect_refused({distances}, ErrorKind::unsupported, "signed distances");
    const auto frustum = with(1);
    frustum->setTransform(openvdb::math::Transform::createFrustumTransform(
        openvdb::BBoxd(openvdb::Vec3d(0.0), openvdb::Vec3d(10.0)), 0.5, 2.0));
    expect_refused({frustum}, ErrorKind::unsupported, "frustum");
    const auto far = with(1);
    far->tree().setValue({1 << 20, 1 << 20, 1 << 20}, 1.0f);
    expect_refused({far}, ErrorKind::memory, "voxels are too many");
    const std::string text = folder_ / "text.vdb";
    std::ofstream(text) << "no grids here, but text that is longer than a header has to be";
    const auto message = [&] {
        try {
            (void)io::read_density(text, "", warnings_);
        } catch (const Error& error) {
            return std::string(error.what());
        }
        return std::string("is read");
    };
    EXPECT_EQ(message(), text + ": cannot be read as an OpenVDB file: not a VDB file");
    const std::string whole = write({with(1)});
    std::filesystem::copy_file(whole, text, std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(text, std::filesystem::file_size(whole) - 30);
    EXPECT_TRUE(message().starts_with(text + ": cannot be read as an OpenVDB file: ")) << message();
    EXPECT_EQ(message().find("Error"), std::string::npos) << message();
    EXPECT_THROW((void)io::read_density(folder_ / "none.vdb", "", warnings_), Error);
}

} // namespace
} // namespace lpvbake
