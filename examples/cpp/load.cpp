// Reads a light volume and prints the irradiance that it gives a surface, by a point in metres and
// a normal:
//
//     load room.vdb  0 1 0  0 1 0
#include "lpvbake/error.h"
#include "lpvbake/file.h"
#include "lpvbake/volume.h"

#include <cstdio>
#include <cstdlib>

int main(int argc, char** argv) {
    if (argc != 8) {
        std::fprintf(stderr, "usage: load VOLUME X Y Z NX NY NZ\n");
        return 1;
    }
    const auto vector = [&](int first) {
        return glm::dvec3(std::atof(argv[first]), std::atof(argv[first + 1]),
                          std::atof(argv[first + 2]));
    };
    try {
        const lpvbake::Volume volume = lpvbake::read_volume(argv[1]); // .vdb, .exr or .json
        const lpvbake::Grid& grid = volume.grid;
        std::printf("grid        %d x %d x %d cells of %g m from %g %g %g\n", grid.dims.x,
                    grid.dims.y, grid.dims.z, grid.cell, grid.origin.x, grid.origin.y,
                    grid.origin.z);
        // volume.sh[k][grid.index(cell)] is coefficient k of a cell, RGB, whatever the file's
        // convention and axes.
        const glm::dvec3 lux = lpvbake::read_irradiance(
            volume, vector(2), glm::normalize(vector(5)), lpvbake::Reading::facing);
        std::printf("irradiance  %.6g %.6g %.6g lux\n", lux.r, lux.g, lux.b);
    } catch (const lpvbake::Error& error) {
        std::fprintf(stderr, "load: %s\n", error.what());
        return error.kind == lpvbake::ErrorKind::file ? 2 : 1;
    }
}
