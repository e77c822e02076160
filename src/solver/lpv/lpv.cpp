#include "solver/lpv/lpv.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>

namespace lpvbake::solver::lpv {
namespace {

constexpr int most_iterations = 100'000;
constexpr int most_corrections = 1000;

/// Share of a front's power by which its lobes may be too steep, for what follows to count as
/// linear. After eight fronts it is 1e-10 without occlusion or with that of links.
constexpr double most_excess = 1e-6;

/// What is missing of a sum whose terms fall, from the last two of them: as if they fell by the
/// same factor on and on, which counts as no less than 0.6.
class Tail {
public:
    double missing(double term) {
        const double factor = std::max(0.6, last_ > 0.0 ? term / last_ : 0.0);
        stalls_ = last_ > 0.0 && term > 0.9 * last_ ? stalls_ + 1 : 0;
        last_ = term;
        return factor < 1.0 ? term * factor / (1.0 - factor) : HUGE_VAL;
    }
    /// Terms in a row that have hardly fallen.
    int stalls() const { return stalls_; }

private:
    double last_ = 0.0;
    int stalls_ = 0;
};

/// Below this share of all power, what is added is rounding.
constexpr double rounding = 3e-7;
/// Times what is missing by the estimate, which may be too low.
constexpr double safety = 2.5;

void tell(Progress& progress, double missing, double tolerance) {
    // What is left falls by about the same factor every step.
    const double way = std::log(std::clamp(missing, tolerance, 1.0)) / std::log(tolerance);
    progress.advance(uint64_t(100.0 * std::clamp(way, 0.0, 1.0)));
}

/// Of links, a mean over their faces where each has its own.
std::vector<float> links_of(const Grid& grid, std::span<const float> transmittance) {
    std::vector<float> links(3 * grid.size());
    tbb::parallel_for(size_t(0), links.size(), [&](size_t i) {
        float sum = 0.0f;
        for (size_t face = 0; face < 5; ++face)
            sum += transmittance[30 * (i / 3) + 10 * (i % 3) + face];
        links[i] = sum / 5.0f;
    });
    return links;
}

} // namespace

uint64_t lpv_device_bytes(const Grid& grid, const LpvSettings& settings, bool layers) {
    const PropagateLayout layout = layout_of(grid);
    return (layers ? 5 : 3) * layout.elements() * sizeof(glm::vec4)
           + layout.elements(planes_of(settings.occlusion)) * sizeof(float)
           + (settings.corrections && settings.iterations == 0 ? corrector_bytes(grid) : 0)
           + (uint64_t(1) << 20);
}

int LpvCourse::iterations() const {
    return fronts + (linear ? 2 : 0) + Corrector::applications * corrections + more;
}

LpvProgram::LpvProgram(const gpu::Device& device, const Grid& grid, Occlusion occlusion,
                       uint64_t window)
    : device_(device),
      grid_(grid),
      occlusion_(occlusion),
      window_(window),
      programs_(compile_propagate(device, grid, occlusion)),
      correct_programs_(compile_correct(device, grid, occlusion)) {}

Diffusion LpvProgram::diffusion(const Injection& injection,
                                std::span<const float> transmittance) const {
    std::vector<uint8_t> lit(grid_.size());
    tbb::parallel_for(size_t(0), lit.size(), [&](size_t cell) {
        for (size_t channel = 0; channel < 3; ++channel)
            if (injection.coefficients[12 * cell + 4 * channel] != 0.0f)
                lit[cell] = 1;
    });
    if (occlusion_ == Occlusion::sh)
        return Diffusion(grid_, links_of(grid_, transmittance), lit);
    return Diffusion(grid_, transmittance, lit);
}

LpvField LpvProgram::propagate(const Injection& injection, std::span<const float> transmittance,
                               const LpvSettings& settings, Progress& progress) const {
    const PropagatePlan plan = plan_propagate(device_, grid_, occlusion_, window_);
    Propagator propagator(device_, grid_, plan, programs_, injection, transmittance);
    LpvField field;
    field.residual = injection.power > 0.0 ? 1.0 : 0.0;
    const bool counted = settings.iterations > 0;
    const int most = counted ? settings.iterations : most_iterations;
    const double tolerance = counted ? 0.0 : double(settings.tolerance);
    double power = injection.power;
    Tail tail;
    field.missing = field.residual;
    int& fronts = field.course.fronts;
    while (fronts < most && field.residual > 0.0 && (counted || field.missing > tolerance)) {
        const int steps = std::min(Propagator::most_steps, most - fronts);
        field.residual = propagator.run(steps) / injection.power;
        fronts += steps;
        power += propagator.run_power();
        if (counted) {
            progress.advance(uint64_t(100.0 * double(fronts) / most));
            continue;
        }
        field.missing = safety * tail.missing(propagator.run_power()) / power;
        tell(progress, field.missing, tolerance);
        if (settings.corrections && std::has_single_bit(unsigned(fronts)))
            correct(propagator, plan, injection, transmittance, tolerance, power, field, progress);
        if (field.course.linear)
            break;
    }
    if (counted)
        field.missing = 0.0;
    field.coefficients = propagator.download();
    if (field.course.linear)
        tbb::parallel_for(size_t(0), 3 * grid_.size(), [&](size_t i) {
            if (field.coefficients[4 * i] < 0.0f)
                std::fill_n(&field.coefficients[4 * i], 4, 0.0f);
        });
    return field;
}

/// Adds all that follows, if it is linear by now.
void LpvProgram::correct(Propagator& propagator, const PropagatePlan& plan,
                         const Injection& injection, std::span<const float> transmittance,
                         double tolerance, double power, LpvField& field,
                         Progress& progress) const {
    Diffusion way = diffusion(injection, transmittance);
    Corrector corrector(device_, grid_, plan, correct_programs_, propagator.buffers(), way);
    LpvCourse& course = field.course;
    course.linear = field.residual > 0.0 && corrector.excess() <= most_excess;
    if (!course.linear)
        return;
    corrector.start();
    Tail tail;
    const auto account = [&](const Added& added) {
        power += added.power;
        const double missing = tail.missing(added.absolute);
        field.missing =
            added.absolute <= rounding * power ? added.absolute / power : safety * missing / power;
        tell(progress, field.missing, tolerance);
        return field.missing > tolerance && added.absolute > rounding * power;
    };
    bool goes_on = true;
    while (goes_on && course.corrections < most_corrections && tail.stalls() < 3) {
        goes_on = account(corrector.correct());
        ++course.corrections;
    }
    tail = {};
    while (goes_on && course.iterations() < most_iterations) {
        goes_on = account(corrector.step(Corrector::most_steps));
        course.more += Corrector::most_steps;
    }
    corrector.step(1); // what is left
}

std::vector<LpvField> LpvProgram::propagate_layers(const Injection& injection,
                                                   std::span<const float> transmittance, int fronts,
                                                   Progress& progress) const {
    const PropagatePlan plan = plan_propagate(device_, grid_, occlusion_, window_);
    const PropagatePrograms programs = compile_propagate(device_, grid_, occlusion_, true);
    std::vector<LpvField> fields;
    for (const std::vector<float>& layer : injection.layers) {
        Propagator propagator(device_, grid_, plan, programs, injection, transmittance, layer);
        LpvField& field = fields.emplace_back();
        int& done = field.course.fronts;
        while (done < fronts) {
            const int steps = std::min(Propagator::most_steps, fronts - done);
            propagator.run(steps);
            done += steps;
            const double way = double(done) / fronts;
            progress.advance(uint64_t(100.0 * (double(fields.size() - 1) + way)
                                      / double(injection.layers.size())));
        }
        field.coefficients = propagator.download();
    }
    return fields;
}

void to_luminance(const LpvField& field, Volume& volume) {
    const size_t n = volume.grid.size();
    volume.sh_order = 1;
    volume.sh.assign(4, std::vector<glm::vec3>(n));
    const double scale = 1.0 / (1.5 * volume.grid.cell * volume.grid.cell);
    tbb::parallel_for(size_t(0), n, [&](size_t cell) {
        for (size_t k = 0; k < 4; ++k) {
            // The light that travels along w arrives from -w: band l changes by (-1)^l.
            const double sign = k == 0 ? scale : -scale;
            for (size_t channel = 0; channel < 3; ++channel)
                volume.sh[k][cell][int(channel)] =
                    float(sign * double(field.coefficients[12 * cell + 4 * channel + k]));
        }
    });
}

} // namespace lpvbake::solver::lpv
