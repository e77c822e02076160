#include "bake/scattering.h"

#include "bake/air.h"
#include "bake/lighting.h"
#include "lpvbake/error.h"
#include "surface/lit_surfaces.h"
#include "text.h"

#include <algorithm>
#include <limits>

namespace lpvbake::bake {
namespace {

constexpr double most_missing = 1e-3; ///< of what is scattered
constexpr double most_unsure = 2e-4;  ///< the same, where it is added: cells differ from the mean
constexpr int most_orders = 256;

/// Stages within one that goes on.
class Silent final : public Progress {
public:
    explicit Silent(Progress& around) : around_(around) {}
    void advance(uint64_t) override { around_.advance(0); }

private:
    Progress& around_;
};

/// Luminous power that cells of air scatter of a light's coefficients, a channel; what is
/// `by_density` is multiplied already.
glm::dvec3 power_of(const medium::LitAir& air, std::span<const std::vector<glm::vec3>> sh,
                    bool by_density) {
    glm::dvec3 sum(0.0);
    for (std::size_t cell = 0; cell < sh[0].size(); ++cell)
        sum += (by_density ? 1.0 : air.density(cell)) * glm::dvec3(sh[0][cell]);
    return sum;
}

/// What lights the cells where the air alone sends light.
Volume field_of_air(const solver::Inputs& inputs, const BakePlan& plan, solver::Solver& solver,
                    Progress& progress) {
    Silent silent(progress);
    std::vector<std::string> warnings; // those of the field have been told
    solver::Stages stages(silent, warnings, inputs.scene.path);
    const surface::LitSurfaces lit = surface::light_surfaces(
        inputs.scene, inputs.visibility, inputs.frame, lighting_of(plan), silent);
    const solver::Inputs own{inputs.scene,      inputs.device, inputs.grid, inputs.frame,
                             inputs.visibility, &lit,          {},          inputs.adjust};
    Volume field;
    field.grid = inputs.grid;
    solver.solve(own, stages, field);
    return field;
}

/// How the orders of a series fall off, and what of it is missing.
class Series {
public:
    /// What the light so far makes air scatter.
    explicit Series(glm::dvec3 first) : sum_(first) {}

    /// Another order.
    void add(glm::dvec3 power) {
        before_ = ratio_;
        for (int c = 0; c < 3; ++c)
            ratio_[c] = last_[c] > 0 ? power[c] / last_[c] : orders_ == 0 ? 1 : 0;
        last_ = power;
        sum_ += power;
        ++orders_;
    }
    int orders() const { return orders_; }
    /// What follows the last order, in units of it, if all fall off as that did.
    glm::dvec3 tail() const {
        glm::dvec3 tail;
        for (int c = 0; c < 3; ++c)
            tail[c] = ratio_[c] < 1 ? ratio_[c] / (1 - ratio_[c])
                                    : std::numeric_limits<double>::infinity();
        return tail;
    }
    /// Share of all that is missing without the tail; and what may be with it, as the last ratios
    /// differ.
    double missing() const { return worst(tail()); }
    double unsure() const {
        glm::dvec3 share;
        for (int c = 0; c < 3; ++c)
            share[c] = ratio_[c] < 1
                           ? std::abs(ratio_[c] - before_[c]) / ((1 - ratio_[c]) * (1 - ratio_[c]))
                           : std::numeric_limits<double>::infinity();
        return orders_ < 3 ? std::numeric_limits<double>::infinity() : worst(share);
    }

private:
    /// Of what is given in units of the last order.
    double worst(glm::dvec3 orders) const {
        double worst = 0;
        for (int c = 0; c < 3; ++c)
            if (last_[c] > 0)
                worst = std::max(worst, last_[c] * orders[c] / sum_[c]);
        return worst;
    }
    glm::dvec3 sum_, last_{0.0}, ratio_{1.0}, before_{1.0};
    int orders_ = 0;
};

void add(const Volume& order, glm::dvec3 times, Volume& volume) {
    for (std::size_t k = 0; k < volume.sh.size(); ++k)
        for (std::size_t cell = 0; cell < volume.sh[k].size(); ++cell)
            volume.sh[k][cell] += glm::vec3(times) * order.sh[k][cell];
}

} // namespace

std::shared_ptr<medium::LitAir> air_in(const BakePlan& plan) {
    if (!plan.settings.scattering)
        return nullptr;
    return std::make_shared<medium::LitAir>(*plan.settings.medium, plan.grid, plan.frame);
}

void add_scattered(const solver::Inputs& inputs, const BakePlan& plan, solver::Solver& solver,
                   medium::LitAir& air, solver::Stages& stages, Volume& volume) {
    const std::optional<int> times = plan.settings.scattering->times;
    volume.metadata["scattering"] = times ? std::to_string(*times) : "inf";
    if (times == 1)
        return;
    stages.begin("scattering");
    const std::vector<std::vector<glm::vec3>> direct =
        direct_in_air(inputs.scene, plan, inputs.visibility, inputs.frame, volume,
                      plan.settings.medium->g == 0 ? 0 : 2, stages.progress())
            .sh;
    air.scatter(volume.sh, direct);
    Series series(power_of(air, volume.sh, false) + power_of(air, direct, true));
    double missing = 0;
    while (!times || series.orders() + 1 < *times) {
        if (series.orders() >= most_orders)
            throw Error(ErrorKind::invalid,
                        inputs.scene.path
                            + format(": %.2g %% of the scattered light is missing after %d times; "
                                     "give a number by `scattering`, or a thinner `medium`",
                                     100 * series.missing(), most_orders));
        const Volume order = field_of_air(inputs, plan, solver, stages.progress());
        series.add(power_of(air, order.sh, false));
        glm::dvec3 weight(1.0);
        const bool ends =
            !times && (series.missing() <= most_missing || series.unsure() <= most_unsure);
        if (ends) {
            missing = std::min(series.missing(), series.unsure());
            if (series.missing() > most_missing)
                weight += series.tail();
        }
        add(order, weight, volume);
        if (ends)
            break;
        air.scatter(order.sh, {});
    }
    air.be_dark();
    stages.end(format("%d times", series.orders() + 1)
               + (times ? "" : format(", about %.1g %% is missing", 100 * missing)));
}

} // namespace lpvbake::bake
