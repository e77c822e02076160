#include "reference/reference.h"

#include "background.h"
#include "lpvbake/error.h"
#include "machine.h"
#include "reference/sampling.h"
#include "scene/lights.h"
#include "text.h"
#include "visibility/validity.h"
#include "visibility/walls.h"
#include "volume/compare.h"
#include "volume/light_content.h"
#include "volume/sh.h"

#include <glm/gtc/constants.hpp>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numeric>

namespace lpvbake::reference {
namespace {

/// Rays of the first pass towards a wanted noise; each further one doubles what there is.
constexpr uint64_t first_pass = 4 * ray_batches;

std::string short_number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.6g", value);
    return text;
}

/// What is estimated at a point, as a row of RGB numbers: its coefficients, then its irradiance on
/// planes of given normals. Each is the integral over the sphere of luminance times a weight.
struct Row {
    int order;
    std::span<const glm::dvec3> normals;
    const glm::dvec3* own = nullptr; ///< one more normal

    size_t coefficients() const { return size_t(volume::sh_count(order)); }
    size_t size() const { return coefficients() + normals.size() + (own != nullptr); }

    void add(glm::dvec3 direction, glm::dvec3 luminance, glm::dvec3* sums) const {
        const volume::ShValues basis = volume::sh_basis(order, glm::vec3(direction));
        for (size_t k = 0; k < coefficients(); ++k)
            *sums++ += double(basis[k]) * luminance;
        for (const glm::dvec3& n : normals)
            *sums++ += std::max(0.0, glm::dot(n, direction)) * luminance;
        if (own)
            *sums += std::max(0.0, glm::dot(*own, direction)) * luminance;
    }
};

/// Fills the row `mean`, which is 0; returns the number of rays.
uint64_t trace_batch(const Paths& paths, glm::vec3 point, uint64_t key, uint32_t rays,
                     const Row& row, glm::dvec3* mean) {
    uint64_t traced = 0;
    const auto add = [&](glm::dvec3 direction, glm::dvec3 luminance) {
        if (luminance != glm::dvec3(0.0))
            row.add(direction, luminance, mean);
    };
    for (uint32_t i = 0; i < rays; ++i) {
        PathSampler sampler(key, i);
        for (const Paths::Glimpse& seen : paths.arriving(point, sampler, traced))
            add(seen.direction, seen.luminance);
    }
    for (size_t i = 0; i < row.size(); ++i)
        mean[i] *= 4.0 * glm::pi<double>() / double(rays);
    return traced;
}

/// Irradiance on a plane that faces each of the 26 normals as weights of the coefficients.
std::vector<std::vector<double>> irradiance_weights(int order) {
    std::vector<std::vector<double>> all;
    for (const glm::dvec3& normal : volume::neighbour_normals()) {
        const volume::ShValues basis = volume::sh_basis(order, glm::vec3(normal));
        std::vector<double> weights(size_t(volume::sh_count(order)));
        for (int l = 0, k = 0; l <= order; ++l)
            for (; k < volume::sh_count(l); ++k)
                weights[size_t(k)] = volume::sh_cosine_factor(l) * double(basis[size_t(k)]);
        all.push_back(weights);
    }
    return all;
}

/// Running sums over the passes of a point: n m, n^2 var(m) of each number m of its row.
struct Totals {
    std::span<glm::dvec3> mean, variance;
    double& irradiance_variance; ///< n^2 var(E), from the coefficients
};

/// Adds a pass of `rays` rays whose batches' rows are given, in their order.
void add_pass(std::span<const glm::dvec3> rows, double rays,
              const std::vector<std::vector<double>>& weights, const Totals& totals) {
    const size_t row = totals.mean.size();
    const double count = ray_batches;
    std::vector<glm::dvec3> mean(row, glm::dvec3(0.0)), off(row);
    for (size_t batch = 0; batch < ray_batches; ++batch)
        for (size_t k = 0; k < row; ++k)
            mean[k] += rows[batch * row + k] / count;
    // Of the mean of independent batches: sum of squares over count (count - 1).
    const double weight = rays * rays / (count * (count - 1.0));
    for (size_t batch = 0; batch < ray_batches; ++batch) {
        for (size_t k = 0; k < row; ++k) {
            off[k] = rows[batch * row + k] - mean[k];
            totals.variance[k] += weight * off[k] * off[k];
        }
        for (const auto& of_normal : weights) {
            glm::dvec3 irradiance{0.0};
            for (size_t k = 0; k < of_normal.size(); ++k)
                irradiance += of_normal[k] * off[k];
            totals.irradiance_variance +=
                weight * glm::dot(irradiance, irradiance) / (3.0 * double(weights.size()));
        }
    }
    for (size_t k = 0; k < row; ++k)
        totals.mean[k] += rays * mean[k];
}

/// Mean over all normals and RGB: only the constant band does not cancel.
double mean_irradiance(glm::dvec3 c0) {
    return 0.5 * std::sqrt(glm::pi<double>()) * (c0.x + c0.y + c0.z) / 3.0;
}

/// Throws Error (memory) unless what is kept of the cells fits this machine.
void check_memory(const Grid& grid, const ReferenceSettings& settings) {
    const uint64_t coefficients = uint64_t(volume::sh_count(settings.sh_order));
    const uint64_t cells = grid.size();
    const uint64_t points = settings.probes ? std::min<uint64_t>(settings.probes, cells) : cells;
    const double bytes = double(cells) * double(24 * coefficients + 24)
                         + double(points) * double(120 * coefficients + 40);
    if (bytes > double(machine_memory()))
        throw Error(ErrorKind::memory,
                    "a reference on " + std::to_string(grid.dims.x) + " x "
                        + std::to_string(grid.dims.y) + " x " + std::to_string(grid.dims.z)
                        + " cells does not fit this machine's memory; lower `resolution`");
}

/// Running sums of all points.
struct ProbeSums {
    size_t row;                               ///< numbers a point
    std::vector<glm::dvec3> means, variances; ///< [point * row + number], as Totals has them
    std::vector<double> irradiance_variances; ///< a point
    uint64_t rays = 0;                        ///< from each point

    ProbeSums(size_t points, size_t numbers)
        : row(numbers),
          means(points * numbers, glm::dvec3(0.0)),
          variances(means),
          irradiance_variances(points) {}

    size_t points() const { return irradiance_variances.size(); }
    Totals of(size_t point) {
        return {{&means[point * row], row},
                {&variances[point * row], row},
                irradiance_variances[point]};
    }
    double irradiance(size_t point) const { return mean_irradiance(means[point * row]); }

    /// Over all points.
    double irradiance() const {
        double sum = 0.0;
        for (size_t i = 0; i < points(); ++i)
            sum += irradiance(i);
        return sum;
    }
    /// As ProbeField::noise.
    double noise() const {
        double error = 0.0;
        for (const double variance : irradiance_variances)
            error += std::sqrt(variance);
        const double sum = irradiance();
        return sum > 0.0 ? error / sum : 0.0;
    }
    /// Appends a number of every point, and its standard error.
    void take(size_t number, std::vector<glm::vec3>& mean, std::vector<glm::vec3>& error) const {
        const double n = double(rays);
        for (size_t i = number; i < means.size(); i += row) {
            mean.push_back(glm::vec3(means[i] / n));
            error.push_back(glm::vec3(glm::sqrt(variances[i]) / n));
        }
    }
};

/// Traces probes, pass by pass.
class ProbeTracer {
public:
    ProbeTracer(const Paths& paths, std::span<const glm::vec3> points,
                std::span<const uint64_t> keys, const ReferenceSettings& settings,
                const ProbeNormals& normals)
        : paths_(paths),
          points_(points),
          keys_(keys),
          settings_(settings),
          normals_(normals),
          weights_(irradiance_weights(settings.sh_order)) {}

    size_t coefficients() const { return size_t(volume::sh_count(settings_.sh_order)); }
    size_t row() const { return coefficients() + normals_.common.size() + !normals_.own.empty(); }

    /// Adds `rays` rays from each point; returns the number of all that were traced for it.
    uint64_t add(uint64_t pass, uint64_t rays, ProbeSums& sums, Progress& progress) {
        const uint64_t threads = uint64_t(threads_at_work());
        // So many points at a time as take about a tenth of a second: progress is told between.
        const size_t step = std::clamp<uint64_t>((threads << 16) / rays, 1, 256);
        uint64_t traced = 0;
        for (size_t first = 0; first < points_.size(); first += step) {
            progress.advance(first);
            traced += add_some(first, std::min(step, points_.size() - first), pass, rays, sums);
        }
        sums.rays += rays;
        return traced;
    }

private:
    uint64_t add_some(size_t first, size_t count, uint64_t pass, uint64_t rays, ProbeSums& sums) {
        const size_t row = sums.row;
        const uint32_t batch_rays = uint32_t(rays / ray_batches);
        batches_.assign(count * ray_batches * row, glm::dvec3(0.0));
        traced_.resize(count * ray_batches);
        tbb::parallel_for(size_t(0), traced_.size(), [&](size_t i) {
            const size_t point = first + i / ray_batches;
            const uint64_t key = join_bits(join_bits(join_bits(settings_.seed, keys_[point]), pass),
                                           i % ray_batches);
            const Row numbers{settings_.sh_order, normals_.common,
                              normals_.own.empty() ? nullptr : &normals_.own[point]};
            traced_[i] =
                trace_batch(paths_, points_[point], key, batch_rays, numbers, &batches_[i * row]);
        });
        tbb::parallel_for(size_t(0), count, [&](size_t i) {
            add_pass({&batches_[i * ray_batches * row], ray_batches * row}, double(rays), weights_,
                     sums.of(first + i));
        });
        return std::accumulate(traced_.begin(), traced_.end(), uint64_t(0));
    }

    const Paths& paths_;
    std::span<const glm::vec3> points_;
    std::span<const uint64_t> keys_;
    const ReferenceSettings& settings_;
    const ProbeNormals& normals_;
    std::vector<std::vector<double>> weights_;
    std::vector<glm::dvec3> batches_; ///< rows
    std::vector<uint64_t> traced_;
};

/// What the sums say.
void take(const ProbeSums& sums, size_t coefficients, const ProbeNormals& normals,
          ProbeField& field) {
    field.sh.resize(coefficients);
    field.error.resize(coefficients);
    field.irradiance.resize(normals.common.size());
    field.irradiance_error.resize(normals.common.size());
    for (size_t k = 0; k < coefficients; ++k)
        sums.take(k, field.sh[k], field.error[k]);
    for (size_t k = 0; k < normals.common.size(); ++k)
        sums.take(coefficients + k, field.irradiance[k], field.irradiance_error[k]);
    if (!normals.own.empty())
        sums.take(sums.row - 1, field.own_irradiance, field.own_irradiance_error);
    for (size_t i = 0; i < sums.points(); ++i) {
        const double irradiance = sums.irradiance(i);
        field.point_noise.push_back(
            irradiance > 0.0 ? float(std::sqrt(sums.irradiance_variances[i]) / irradiance) : 0.0f);
    }
}

/// "trace 1024, noise 4.1 %, about 30 s to go".
std::string pass_name(const ProbeSums& sums, uint64_t rays, double seconds_a_ray,
                      const ReferenceSettings& settings) {
    std::string name = "trace " + std::to_string(sums.rays + rays);
    if (sums.rays == 0)
        return name;
    const double noise = sums.noise();
    name += format(", noise %s %%", two_digits(100.0 * noise).c_str());
    const double more = settings.noise > 0.0 ? noise / settings.noise : 1.0;
    const double wanted = std::min(double(settings.rays), double(sums.rays) * more * more);
    if (settings.noise > 0.0)
        name += format(", about %s s to go",
                       two_digits(seconds_a_ray * (wanted - double(sums.rays))).c_str());
    return name;
}

/// The cells whose light is found.
std::vector<size_t> probe_cells(const Scene& scene, const std::vector<float>& validity,
                                const ReferenceSettings& settings) {
    std::vector<size_t> cells;
    if (settings.probes > 0) {
        cells = sample_cells(valid_cells(validity), settings.probes,
                             mix_bits(settings.seed ^ 0x70726f6265u));
        if (cells.empty())
            throw Error(ErrorKind::invalid,
                        scene.path + ": no cell of the grid has its centre outside geometry");
    } else {
        cells.resize(validity.size());
        std::iota(cells.begin(), cells.end(), size_t(0));
    }
    return cells;
}

std::vector<std::string> warnings_of(const Scene& scene, const ProbeField& field,
                                     const ReferenceSettings& settings, size_t cells) {
    std::vector<std::string> warnings;
    if (!field.converged)
        warnings.push_back(about(
            scene.path, "the noise is still " + short_number(100.0 * field.noise) + " % after "
                            + std::to_string(field.rays) + " rays a cell; raise `rays`"));
    if (settings.probes > cells)
        warnings.push_back(about(scene.path, "only " + std::to_string(cells)
                                                 + " cells are valid; all of them are probes"));
    return warnings;
}

/// Puts the field of some cells into volumes whose grids are there, and sums up its errors.
void scatter(const ProbeField& field, std::span<const size_t> cells, Reference& reference) {
    std::string errors;
    for (size_t k = 0; k < field.sh.size(); ++k) {
        double squares = 0.0;
        for (size_t i = 0; i < cells.size(); ++i) {
            reference.volume.sh[k][cells[i]] = field.sh[k][i];
            reference.error.sh[k][cells[i]] = field.error[k][i];
            const glm::dvec3 e{field.error[k][i]};
            squares += glm::dot(e, e);
        }
        reference.standard_error.push_back(std::sqrt(squares / (3.0 * double(cells.size()))));
        errors += k > 0 ? " " : "";
        errors += short_number(reference.standard_error.back());
    }
    reference.volume.metadata["standard_error"] = errors;
    reference.error.metadata["quantity"] = "standard error";
}

} // namespace

ProbeField trace_probes(const Scene& scene, const visibility::Visibility& visibility,
                        const scene::Frame& frame, std::span<const glm::vec3> points,
                        std::span<const uint64_t> keys, const ReferenceSettings& settings,
                        Progress& progress, const ProbeNormals& normals) {
    const Paths paths(scene, visibility, frame, settings.paths);
    ProbeTracer tracer(paths, points, keys, settings, normals);
    ProbeSums sums(points.size(), tracer.row());
    const uint64_t limit =
        (std::max<uint64_t>(settings.rays, 1) + ray_batches - 1) / ray_batches * ray_batches;
    ProbeField field;
    const auto begin = std::chrono::steady_clock::now();
    const bool by_passes = settings.noise > 0.0 || settings.seconds > 0.0;
    for (uint64_t pass = 0; sums.rays < limit; ++pass) {
        const uint64_t rays =
            by_passes ? std::min(pass == 0 ? first_pass : sums.rays, limit - sums.rays) : limit;
        const double taken =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        const double a_ray = pass > 0 ? taken / double(sums.rays) : 0.0;
        if (pass > 0 && settings.seconds > 0.0 && taken + a_ray * double(rays) > settings.seconds)
            break;
        const ProbeSums whole = sums;
        try {
            progress.begin(by_passes ? pass_name(sums, rays, a_ray, settings) : "trace",
                           points.size());
            field.traced += tracer.add(pass, rays, sums, progress);
        } catch (const Error& error) {
            field.interrupted =
                error.kind == ErrorKind::interrupted || error.kind == ErrorKind::terminated;
            if (!field.interrupted || whole.rays == 0)
                throw;
            sums = whole;
            break;
        }
        field.noise = sums.noise();
        if (settings.noise > 0.0 && sums.irradiance() > 0.0 && field.noise <= settings.noise)
            break;
    }
    field.rays = sums.rays;
    field.converged = !(settings.noise > 0.0) || field.noise <= settings.noise;
    take(sums, tracer.coefficients(), normals, field);
    return field;
}

Reference make_reference(const Scene& scene, const Grid& grid, const ReferenceSettings& settings,
                         Progress& progress) {
    if (scene::triangle_count(scene) == 0)
        throw Error(ErrorKind::invalid, scene.path + ": no triangles to light");
    scene::check_light_arrives(scene.path,
                               {.punctual = !scene.lights.empty(),
                                .emitters = settings.paths.emitters && scene::has_emitters(scene),
                                .sky = scene::has_sky(scene),
                                .statics = !scene::static_names(scene).empty(),
                                .bounces = settings.paths.bounces});
    check_memory(grid, settings);

    progress.begin("visibility", 0);
    const scene::Frame frame = scene::frame_of(grid);
    const visibility::Visibility visibility(scene, frame, settings.isa);
    const std::vector<float> validity = visibility::trace_validity(visibility, grid.dims);

    const std::vector<size_t> cells = probe_cells(scene, validity, settings);
    std::vector<glm::vec3> points;
    std::vector<uint64_t> keys;
    for (const size_t cell : cells) {
        points.push_back(visibility.capture(grid.cell_at(cell)).point);
        keys.push_back(cell);
    }
    const ProbeField field =
        trace_probes(scene, visibility, frame, points, keys, settings, progress);

    Reference reference;
    reference.noise = field.noise;
    reference.rays = field.rays;
    reference.traced = field.traced;
    reference.probes = cells.size();
    reference.interrupted = field.interrupted;
    reference.warnings = warnings_of(scene, field, settings, cells.size());

    Volume& volume = reference.volume;
    volume.grid = grid;
    volume.sh_order = settings.sh_order;
    volume.validity.assign(grid.size(), 0.0f);
    volume.sh.assign(field.sh.size(), std::vector<glm::vec3>(grid.size(), glm::vec3(0.0f)));
    for (const size_t cell : cells)
        volume.validity[cell] = validity[cell];
    volume.metadata = {
        {"solver", "reference"},
        {"bounces", settings.paths.bounces ? std::to_string(*settings.paths.bounces) : "inf"},
        {"rays", std::to_string(field.rays)},
        {"seed", std::to_string(settings.seed)},
        {"noise", short_number(field.noise)},
        {"tracer", visibility.tracer()},
    };
    volume::LightContent content = volume::content_of(
        !scene.lights.empty(), settings.paths.emitters && scene::has_emitters(scene),
        scene::has_sky(scene), settings.paths.bounces);
    const std::vector<std::string> statics = scene::static_names(scene);
    volume::add_statics(statics, statics.size() == scene.lights.size(), settings.paths.bounces,
                        content);
    volume::set_content(content, volume.metadata);
    if (settings.probes > 0)
        volume.metadata["probes"] = std::to_string(cells.size());
    reference.error = volume;
    volume.walls =
        visibility::find_walls(visibility, grid.dims, volume.validity, most_walls, walls_reach);
    scatter(field, cells, reference);
    return reference;
}

} // namespace lpvbake::reference
