#include "volume/grids.h"

#include "volume/sh.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <type_traits>

namespace lpvbake::volume {
namespace {

constexpr GridKind light{.name = "sh",
                         .channels = "rgb",
                         .turning = Turning::harmonics,
                         .most = sh_count(sh_max_order),
                         .member = &Volume::sh};
constexpr GridKind occlusion{.name = "occlusion",
                             .turning = Turning::harmonics,
                             .fewest = 4,
                             .most = 4,
                             .quantity = {"blocking potential", "1"},
                             .subtracted = true,
                             .member = &Volume::occlusion};
constexpr GridKind validity{
    .name = "validity", .quantity = {"validity", "1"}, .member = &Volume::validity};
constexpr GridKind wall{.name = "wall",
                        .channels = "xyz",
                        .turning = Turning::vector,
                        .most = most_walls,
                        .quantity = {"way to a plane that hides what is beyond", "cells"},
                        .member = &Volume::walls};
constexpr GridKind direct{.name = "direct",
                          .channels = "rgb",
                          .turning = Turning::harmonics,
                          .most = sh_count(sh_max_order),
                          .quantity = {"direct luminance of punctual lights", "cd/m^2"},
                          .subtracted = true};
constexpr GridKind visibility{.name = "visibility",
                              .most = most_visibilities,
                              .quantity = {"share of a light that arrives", "1"},
                              .subtracted = true};
constexpr GridKind shadow{.name = "shadow",
                          .fewest = 4,
                          .most = 4,
                          .quantity = {"share that arrives of the lights of a channel", "1"},
                          .subtracted = true};
constexpr GridKind shaft{.name = "shaft",
                         .quantity = {"share of a light that comes through holes", "1"},
                         .subtracted = true};
constexpr GridKind scatter{
    .name = "scatter",
    .channels = "rgb",
    .quantity = {"luminance that air scatters a metre, mean over directions", "cd/m^3"},
    .subtracted = true};
constexpr GridKind scattered{
    .name = "scattered",
    .channels = "rgb",
    .turning = Turning::harmonics,
    .most = sh_count(sh_max_order),
    .quantity = {"luminance that air scatters a metre, by where one looks", "cd/m^3"},
    .subtracted = true};
constexpr GridKind extinction{.name = "extinction",
                              .channels = "rgb",
                              .quantity = {"share of light that air takes a metre", "1/m"},
                              .subtracted = true};
constexpr GridKind sky_occlusion{.name = "sky_occlusion",
                                 .turning = Turning::harmonics,
                                 .fewest = 4,
                                 .most = 4,
                                 .quantity = {"irradiance over pi of a white sky of 1", "1"},
                                 .subtracted = true};
constexpr GridKind sky_direction{.name = "sky_direction",
                                 .channels = "xyz",
                                 .turning = Turning::vector,
                                 .quantity = {"direction of the light of a white sky", "1"}};
constexpr GridKind local_transfer{.name = "local_transfer",
                                  .channels = "rgb",
                                  .turning = Turning::operators,
                                  .fewest = 16,
                                  .most = 16,
                                  .quantity = {"light off near surfaces over that around", "1"},
                                  .subtracted = true};
constexpr GridKind local_visibility{.name = "local_visibility",
                                    .turning = Turning::harmonics,
                                    .fewest = 9,
                                    .most = 9,
                                    .quantity = {"what near surfaces leave to be seen", "1"},
                                    .subtracted = true};
constexpr const GridKind* kinds[] = {
    &light,      &occlusion,     &validity,      &wall,           &direct,
    &visibility, &shadow,        &shaft,         &scatter,        &scattered,
    &extinction, &sky_occlusion, &sky_direction, &local_transfer, &local_visibility};

constexpr const char* coefficient_names[] = {
    "l0",    "l1_y",  "l1_z",  "l1_x",  "l2_xy", "l2_yz", "l2_z2", "l2_xz", "l2_x2y2",
    "l3_n3", "l3_n2", "l3_n1", "l3_0",  "l3_p1", "l3_p2", "l3_p3", "l4_n4", "l4_n3",
    "l4_n2", "l4_n1", "l4_0",  "l4_p1", "l4_p2", "l4_p3", "l4_p4"};
static_assert(std::size(coefficient_names) == sh_count(sh_max_order));

/// Calls visit(cells, ...) with what the volume keeps the kind's grids in: a vector of floats, or
/// of vectors of floats or of glm::vec3.
template <class AnyVolume, class Visit>
void visit_storage(AnyVolume& volume, const GridKind& kind, const Visit& visit) {
    std::visit(
        [&](const auto& member) {
            if constexpr (!std::is_same_v<std::decay_t<decltype(member)>, std::monostate>)
                visit(volume.*member);
            else if (const auto found = std::ranges::find(volume.others, &kind, &OtherGrids::kind);
                     found != volume.others.end())
                visit(found->grids);
        },
        kind.member);
}

template <class Float, class AnyVolume>
void append(AnyVolume& volume, const GridKind& kind, std::vector<BasicGridView<Float>>& views) {
    const auto add = [&](auto& cells, std::size_t floats) {
        int k = 0;
        for (auto view = views.rbegin(); view != views.rend() && view->kind == &kind; ++view)
            ++k;
        Float* data = nullptr;
        if constexpr (std::is_same_v<std::decay_t<decltype(cells[0])>, glm::vec3>)
            data = cells.empty() ? nullptr : &cells[0].x;
        else
            data = cells.data();
        views.push_back({&kind, k, data, cells.size() / floats});
    };
    visit_storage(volume, kind, [&](auto& storage) {
        using Element = std::decay_t<decltype(storage[0])>;
        if constexpr (std::is_same_v<Element, float>) {
            if (!storage.empty())
                add(storage, 1);
        } else {
            // Cells of glm::vec3 are whole; those of Volume::others are floats in a row.
            const bool whole = std::is_same_v<Element, std::vector<glm::vec3>>;
            for (auto& cells : storage)
                add(cells, whole ? 1 : std::size_t(kind.width()));
        }
    });
}

template <class Float, class AnyVolume>
std::vector<BasicGridView<Float>> all_grids(AnyVolume& volume) {
    std::vector<BasicGridView<Float>> views;
    for (const GridKind* kind : kinds)
        append(volume, *kind, views);
    for (const OtherGrids& other : volume.others)
        if (std::ranges::find(kinds, other.kind) == std::end(kinds))
            append(volume, *other.kind, views);
    return views;
}

} // namespace

GridKinds grid_kinds() {
    return kinds;
}

const GridKind& kind_named(const char* name) {
    return **std::ranges::find(kinds, std::string(name),
                               [](const GridKind* kind) { return std::string(kind->name); });
}

const GridKind& light_kind() {
    return light;
}

const GridKind& direct_kind() {
    return direct;
}

const GridKind& visibility_kind() {
    return visibility;
}

const GridKind& sky_occlusion_kind() {
    return sky_occlusion;
}

const GridKind& sky_direction_kind() {
    return sky_direction;
}

const GridKind& local_transfer_kind() {
    return local_transfer;
}

const GridKind& local_visibility_kind() {
    return local_visibility;
}

const char* coefficient_name(int k) {
    return coefficient_names[k];
}

std::string grid_name(const GridKind& kind, int k) {
    std::string name = kind.name;
    if (kind.turning == Turning::operators)
        return name + '_' + coefficient_name(k / 4) + '_' + coefficient_name(k % 4);
    if (kind.most > 1)
        (name += '_') +=
            kind.turning == Turning::harmonics ? coefficient_name(k) : std::to_string(k);
    return name;
}

std::vector<GridView> grids_of(Volume& volume) {
    return all_grids<float>(volume);
}

std::vector<ConstGridView> grids_of(const Volume& volume) {
    return all_grids<const float>(volume);
}

std::vector<GridView> grids_of(Volume& volume, const GridKind& kind) {
    std::vector<GridView> views;
    append(volume, kind, views);
    return views;
}

std::vector<ConstGridView> grids_of(const Volume& volume, const GridKind& kind) {
    std::vector<ConstGridView> views;
    append(volume, kind, views);
    return views;
}

void set_grids(Volume& volume, const GridKind& kind, int count) {
    if (std::holds_alternative<std::monostate>(kind.member)) {
        std::erase_if(volume.others, [&](const OtherGrids& other) { return other.kind == &kind; });
        if (count > 0)
            volume.others.push_back({&kind, {}});
    }
    const std::size_t cells = volume.grid.size();
    visit_storage(volume, kind, [&](auto& storage) {
        using Element = std::decay_t<decltype(storage[0])>;
        if constexpr (std::is_same_v<Element, float>)
            storage.assign(count > 0 ? cells : 0, 0.0f);
        else if constexpr (std::is_same_v<Element, std::vector<glm::vec3>>)
            storage.assign(std::size_t(count), Element(cells, glm::vec3(0.0f)));
        else
            storage.assign(std::size_t(count), Element(cells * std::size_t(kind.width()), 0.0f));
    });
}

GridRange range_of(const ConstGridView& grid) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const auto channels = std::size_t(grid.kind->width());
    GridRange range{std::vector(channels, infinity), std::vector(channels, -infinity),
                    std::vector(channels, 0.0)};
    for (std::size_t cell = 0; cell < grid.cells; ++cell) {
        bool any = false;
        for (std::size_t c = 0; c < channels; ++c) {
            const double value = grid.data[cell * channels + c];
            range.min[c] = std::min(range.min[c], value);
            range.max[c] = std::max(range.max[c], value);
            range.mean[c] += value / double(grid.cells);
            any = any || value != 0;
        }
        range.nonzero += any;
    }
    return range;
}

} // namespace lpvbake::volume
