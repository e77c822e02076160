#include "surface/patches.h"

#include "lpvbake/error.h"
#include "scene/emission.h"
#include "scene/material.h"
#include "scene/roles.h"
#include "surface/cutting.h"
#include "surface/in_place.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <iterator>
#include <optional>

namespace lpvbake::surface {
float ray_offset(glm::vec3 point) {
    const glm::vec3 size = glm::abs(point);
    return 1e-4f + 4e-6f * std::max({size.x, size.y, size.z});
}

namespace {

/// 2 GiB of them. Many sheets that lie on each other could ask for any number.
constexpr uint64_t most_patches = 1 << 25;

/// A corner of a piece: where it is, and its weights in the triangle that it was cut from.
struct Corner {
    glm::vec3 position;
    glm::vec2 barycentric;
};
using Piece = std::array<Corner, 3>;

/// Stratified points of a triangle: centroids of the 16 triangles of its twofold subdivision.
std::array<glm::vec2, 16> sample_points() {
    std::array<glm::vec2, 16> points;
    size_t n = 0;
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4 - i; ++j) {
            points[n++] = {(float(i) + 1.0f / 3.0f) / 4.0f, (float(j) + 1.0f / 3.0f) / 4.0f};
            if (i + j < 3)
                points[n++] = {(float(i) + 2.0f / 3.0f) / 4.0f, (float(j) + 2.0f / 3.0f) / 4.0f};
        }
    return points;
}

bool outside(const Piece& piece, glm::vec3 extent) {
    const glm::vec3 a = piece[0].position, b = piece[1].position, c = piece[2].position;
    return glm::any(glm::lessThan(glm::max(a, glm::max(b, c)), glm::vec3(0.0f)))
           || glm::any(glm::greaterThan(glm::min(a, glm::min(b, c)), extent));
}

Corners corners_of(const Piece& piece) {
    return {piece[0].position, piece[1].position, piece[2].position};
}

/// None of what has no area.
std::optional<glm::vec3> normal_of(glm::vec3 a, glm::vec3 b, glm::vec3 c) {
    const glm::dvec3 normal =
        glm::cross(glm::dvec3(b) - glm::dvec3(a), glm::dvec3(c) - glm::dvec3(a));
    const double length = glm::length(normal);
    return length > 0.0 ? std::optional(glm::vec3(normal / length)) : std::nullopt;
}

/// Triangles are cut in runs of this many, so that threads share a large mesh.
constexpr size_t run_length = 256;

/// How far off its place (cells) a patch may send its light: of the centre, and of the mean square
/// of the distance from it. What is within an eighth of a cell is always even enough.
constexpr float most_shift = 0.06f, most_spread = 0.02f;

/// How far above a surface a lamp lies close to it, cells.
constexpr float cover_reach = 0.5f;

/// The box of a mesh that glows, frame units.
struct LampBox {
    glm::vec3 lo{HUGE_VALF}, hi{-HUGE_VALF};
};

/// What rays of the cutter's frame meet, which may be placed in another one.
struct Walls {
    const visibility::Visibility& visibility;
    float scale = 1.0f;     ///< units of that one in one of the cutter's
    glm::vec3 origin{0.0f}; ///< of the cutter's, there
    bool on_trial = false;  ///< patches are but counted

    glm::vec3 place(glm::vec3 point) const { return scale * point + origin; }
    visibility::Ray ray(glm::vec3 from, glm::vec3 way) const { return {place(from), scale * way}; }
    bool block(glm::vec3 from, glm::vec3 way) const {
        return visibility.transmittance(ray(from, way)) < 0.5f;
    }
    /// As ray_offset, by the coarser of both frames.
    float offset(glm::vec3 point) const {
        return std::max(ray_offset(point), ray_offset(place(point)) / scale);
    }
    /// To what lies close above a point of a surface, on this side of it.
    visibility::Ray ray_above(glm::vec3 point, glm::vec3 normal) const {
        return ray(point + offset(point) * normal, cover_reach / visibility.scale() * normal);
    }
    bool cover(glm::vec3 point, glm::vec3 normal) const {
        return visibility.transmittance(ray_above(point, normal)) < 0.5f;
    }
};

/// What stands on a piece, or close above a part of it.
struct Standing {
    bool crossed = false;    ///< Patch::crossed
    uint8_t cover = 0;       ///< PatchTree::Node::cover
    bool fading = false;     ///< Patch::fading
    uint8_t under = 0;       ///< Patch::under
    float least = HUGE_VALF; ///< edge down to which it is cut, frame units
};

std::vector<LampBox> lamp_boxes(const Scene& scene, const scene::Frame& frame) {
    std::vector<LampBox> boxes;
    for (const Instance& instance : scene.instances) {
        const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
        if (scene.materials[size_t(mesh.material)].emission == glm::vec3(0.0f)
            || !scene::shines(instance.role))
            continue;
        LampBox& box = boxes.emplace_back();
        for (const glm::vec3& p : scene::positions_in_frame(scene, instance, frame)) {
            box.lo = glm::min(box.lo, p);
            box.hi = glm::max(box.hi, p);
        }
    }
    return boxes;
}

/// Cuts one run of an instance's triangles.
class Cutter {
public:
    using Node = PatchTree::Node;
    const Scene& scene;
    const Mesh& mesh;
    const Boxes boxes;
    const float max_edge;
    const Walls* walls; ///< none: only what lies in the grid, and no tree
    const bool textured;
    const bool tinting; ///< what covers nothing is there all the same
    const bool reflects;
    const scene::EmissionMaps* emission; ///< none: nothing emits
    const std::vector<LampBox>& lamps;
    std::atomic<uint64_t>& made; ///< patches so far, of the whole scene
    Patch source;                ///< what all pieces of a triangle share

    std::vector<Patch> patches;
    std::vector<Node> pieces, nodes;    ///< as PatchTree has them, of the run
    std::vector<PatchTree::Root> roots; ///< a triangle of the run

    void cut(const Piece& triangle) {
        const int turn = longest_edge(corners_of(triangle)).at;
        const uint32_t root = grow();
        std::vector<std::pair<Piece, uint32_t>> stack{{turned(triangle, turn), root}};
        while (!stack.empty()) {
            const auto [piece, node] = stack.back();
            stack.pop_back();
            if (!walls && outside(piece, boxes.extent))
                continue;
            const auto [edge, length] = longest_edge(corners_of(piece));
            const auto [a, b, c] = turned(piece, edge);
            const float most = limit(piece);
            const bool large = length > most;
            const Standing above = large ? Standing() : standing_on(piece, length);
            bool halve = large || length > above.least;
            scene::PieceEmission glow;
            if (!halve && textured && emission) {
                glow = emission->over(
                    mesh, source.triangle,
                    {piece[0].barycentric, piece[1].barycentric, piece[2].barycentric});
                halve = is_uneven(glow, piece, most);
            }
            if (halve) {
                const Corner middle{0.5f * (a.position + b.position),
                                    0.5f * (a.barycentric + b.barycentric)};
                const uint32_t half = grow();
                grow();
                if (walls)
                    nodes[node] = {half, true, uint8_t(edge)};
                stack.push_back({{b, c, middle}, half});
                stack.push_back({{c, a, middle}, half + 1});
                continue;
            }
            keep(piece, node, above, glow);
        }
        if (walls)
            keep_root(root, turn);
    }

private:
    uint32_t grow() {
        if (!walls)
            return 0;
        nodes.push_back({});
        return uint32_t(nodes.size() - 1);
    }

    static Piece turned(const Piece& piece, int by) {
        return {piece[size_t(by)], piece[size_t(by + 1) % 3], piece[size_t(by + 2) % 3]};
    }

    /// The root of a triangle that begins at a node: as deep as all of it is halved alike.
    void keep_root(uint32_t node, int turn) {
        PatchTree::Root root{uint32_t(pieces.size()), 0, uint8_t(turn)};
        std::vector<Node> level{nodes[node]}, halves;
        const auto halved = [](const Node& n) { return n.halved && n.turn == 0; };
        while (std::ranges::all_of(level, halved)) {
            halves.clear();
            for (const Node& n : level)
                halves.insert(halves.end(), {nodes[n.at], nodes[n.at + 1]});
            std::swap(level, halves);
            ++root.levels;
        }
        roots.push_back(root);
        pieces.insert(pieces.end(), level.begin(), level.end());
    }

    float limit(const Piece& piece) const {
        return walls ? edge_limit(corners_of(piece), boxes, max_edge) : max_edge;
    }

    /// True if something stands on the piece between its centroid and its corners.
    bool is_crossed(const Piece& piece) const {
        if (!walls)
            return false;
        const glm::vec3 centroid =
            (piece[0].position + piece[1].position + piece[2].position) / 3.0f;
        for (const float side : {1.0f, -1.0f}) {
            if (side < 0.0f && !source.double_sided)
                continue;
            const glm::vec3 from = centroid + side * walls->offset(centroid) * source.normal;
            for (const Corner& corner : piece)
                if (walls->block(from, 0.96f * (corner.position - centroid)))
                    return true;
        }
        return false;
    }

    Standing standing_on(const Piece& piece, float length) const {
        if (!walls)
            return {};
        Standing standing;
        const float edge = edge_of_cells(piece);
        if (length > edge / 128.0f)
            standing = lamps_above(piece);
        if (!standing.crossed && length > edge / 16.0f && is_crossed(piece)) {
            standing.crossed = true;
            standing.least = std::min(standing.least, edge / 8.0f);
        }
        return standing;
    }

    /// Longest edge that a patch may have in the grid, or in the box that the piece lies in.
    float edge_of_cells(const Piece& piece) const {
        return max_edge
               * boxes.cell_at((piece[0].position + piece[1].position + piece[2].position) / 3.0f);
    }

    /// Lamps close above a part of the piece, which would spread their light over all of it. It
    /// fades around the end of the gap between them as fast as that is narrow: the piece is cut
    /// until it is no larger, also where that end is about as near as the piece is long.
    Standing lamps_above(const Piece& piece) const {
        const Corners at = corners_of(piece);
        const glm::vec3 centroid = (at[0] + at[1] + at[2]) / 3.0f;
        Corners around = at;
        for (glm::vec3& corner : around)
            corner = centroid + 3.0f * (corner - centroid);
        const auto [a, b, c] = around;
        const glm::vec3 lo = walls->place(glm::min(a, glm::min(b, c)) - cover_reach);
        const glm::vec3 hi = walls->place(glm::max(a, glm::max(b, c)) + cover_reach);
        if (std::ranges::none_of(lamps, [&](const LampBox& lamp) {
                return glm::all(glm::lessThan(lamp.lo, hi))
                       && glm::all(glm::greaterThan(lamp.hi, lo));
            }))
            return {};
        Standing standing;
        float gap = HUGE_VALF;
        for (const int side : {0, 1}) {
            if (side != 0 && !source.double_sided)
                continue;
            const glm::vec3 normal = side != 0 ? -source.normal : source.normal;
            const Gap above = gap_above(at, normal), near = gap_above(around, normal);
            const bool under = walls->cover(centroid, normal);
            if (under && above.width < HUGE_VALF)
                standing.under |= uint8_t(1u << side);
            if (above.ends || near.ends)
                gap = std::min({gap, above.width, near.width});
            if (above.ends) {
                standing.crossed = true;
                standing.cover |= uint8_t((under ? 5u : 1u) << side);
            }
        }
        if (gap < HUGE_VALF) {
            const float edge = edge_of_cells(piece);
            standing.fading = true;
            standing.least = std::clamp(gap, edge / 64.0f, edge / 8.0f);
        }
        return standing;
    }

    /// Between the points of a triangle and a lamp close above some of them.
    struct Gap {
        bool ends = false;       ///< other points have nothing above them
        float width = HUGE_VALF; ///< where it is narrowest, frame units; no lamp: HUGE_VALF
    };

    Gap gap_above(const Corners& at, glm::vec3 normal) const {
        static const std::array<glm::vec2, 24> points = [] {
            std::array<glm::vec2, 24> all;
            std::ranges::copy(sample_points(), all.begin());
            // Near the rim, so that no strip is missed.
            constexpr float in = 0.005f, out = 1.0f - 2.0f * in, half = 0.5f * (1.0f - in);
            constexpr glm::vec2 rim[] = {
                {in, in},   {out, in},  {in, out},           {half, half},
                {in, half}, {half, in}, {0.25f, 0.75f - in}, {0.75f - in, 0.25f}};
            std::ranges::copy(rim, all.begin() + 16);
            return all;
        }();
        std::array<visibility::Ray, points.size()> rays;
        std::array<visibility::Hit, points.size()> hits;
        for (size_t i = 0; i < points.size(); ++i) {
            const glm::vec3 p =
                at[0] + points[i].x * (at[1] - at[0]) + points[i].y * (at[2] - at[0]);
            rays[i] = walls->ray_above(p, normal);
        }
        walls->visibility.closest_of_eights(rays, visibility::Bundle::tight, hits);
        Gap gap;
        size_t covered = 0;
        for (const visibility::Hit& hit : hits)
            if (hit.instance != visibility::no_hit) {
                ++covered;
                if (glows(hit.instance) && hit.facing != visibility::Facing::back)
                    gap.width = std::min(gap.width, hit.t * cover_reach);
            }
        gap.ends = gap.width < HUGE_VALF && covered < points.size();
        return gap;
    }

    bool glows(uint32_t instance) const {
        const Mesh& of = scene.meshes[size_t(scene.instances[instance].mesh)];
        return scene.materials[size_t(of.material)].emission != glm::vec3(0.0f)
               && scene::shines(scene.instances[instance].role);
    }

    /// True if the piece's light comes from a part of it, that a patch would spread.
    static bool is_uneven(const scene::PieceEmission& glow, const Piece& piece, float most) {
        const scene::Unevenness uneven = scene::unevenness(
            glow, piece[1].position - piece[0].position, piece[2].position - piece[0].position);
        return uneven.shift > most_shift * most || uneven.spread > most_spread * most * most;
    }

    void keep(const Piece& piece, uint32_t node, const Standing& above,
              const scene::PieceEmission& glow) {
        const glm::vec3 a = piece[0].position, b = piece[1].position, c = piece[2].position;
        Patch patch = source;
        patch.position = (a + b + c) / 3.0f;
        if (!walls
            && (glm::any(glm::lessThan(patch.position, glm::vec3(0.0f)))
                || glm::any(glm::greaterThan(patch.position, boxes.extent))))
            return;
        patch.crossed = above.crossed;
        patch.fading = above.fading;
        patch.under = above.under;
        patch.edge_u = b - a;
        patch.edge_v = c - a;
        patch.area = 0.5f * glm::length(glm::cross(patch.edge_u, patch.edge_v));
        if (textured) {
            shade(piece, patch);
            patch.emission = glow.mean;
        }
        if (!(patch.area > 0.0f && (patch.alpha > 0.0f || tinting)))
            return;
        if (++made > most_patches)
            throw Error(ErrorKind::memory,
                        scene.path + ": more than " + std::to_string(most_patches)
                            + " patches of surface lie in the grid; lower `resolution`");
        if (walls) {
            nodes[node] = {uint32_t(patches.size()), false, 0, above.crossed, above.cover};
            if (!walls->on_trial && patch.met && patch.alpha >= 1.0f
                && is_hidden(walls->visibility, patch))
                patch.area = 0.0f;
        }
        patches.push_back(patch);
    }

    void shade(const Piece& piece, Patch& patch) const {
        static const std::array<glm::vec2, 16> points = sample_points();
        glm::vec3 albedo{0.0f};
        float alpha = 0.0f;
        for (const glm::vec2& p : points) {
            const glm::vec2 b = (1.0f - p.x - p.y) * piece[0].barycentric
                                + p.x * piece[1].barycentric + p.y * piece[2].barycentric;
            const scene::SurfaceSample surface =
                scene::sample_surface(scene, mesh, patch.triangle, b);
            alpha += surface.alpha;
            if (reflects)
                albedo += surface.alpha * surface.albedo;
        }
        patch.albedo = alpha > 0.0f ? albedo / alpha : glm::vec3(0.0f);
        patch.alpha = alpha / float(points.size());
    }
};

/// Of an instance, before any of its triangles.
Cutter blank_cutter(const Scene& scene, uint32_t index, const Boxes& boxes, float max_edge,
                    const Walls* walls, const scene::EmissionMaps* emission,
                    const std::vector<LampBox>& lamps, std::atomic<uint64_t>& made) {
    const Role role = scene.instances[index].role;
    const Mesh& mesh = scene.meshes[size_t(scene.instances[index].mesh)];
    const Material& material = scene.materials[size_t(mesh.material)];
    const bool glows = material.emission != glm::vec3(0.0f) && scene::shines(role);
    Cutter blank{scene,
                 mesh,
                 boxes,
                 max_edge,
                 walls,
                 scene::is_partly_clear(material) || material.emission_texture >= 0
                     || material.base_color_texture >= 0 || !mesh.colors.empty(),
                 scene::is_tinting(scene, mesh),
                 scene::reflects(role),
                 glows ? emission : nullptr,
                 lamps,
                 made,
                 {},
                 {},
                 {},
                 {},
                 {}};
    blank.source.instance = index;
    blank.source.double_sided = material.double_sided;
    blank.source.met = scene::blocks(role);
    blank.source.asked = scene::is_asked(role);
    if (!blank.textured && !mesh.triangles.empty()) {
        if (blank.reflects)
            blank.source.albedo =
                scene::sample_surface(scene, mesh, 0, glm::vec2(1.0f / 3.0f)).albedo;
        if (glows)
            blank.source.emission = material.emission;
    }
    return blank;
}

/// Whether light is not the same with surfaces of a role as without.
bool acts(Role role) {
    return scene::blocks(role) || scene::shines(role);
}

/// The pieces of an instance, by runs.
std::vector<Cutter> cut_instance(const Scene& scene, uint32_t index, const scene::Frame& frame,
                                 float max_edge, const Walls* walls,
                                 const scene::EmissionMaps* emission,
                                 const std::vector<LampBox>& lamps, std::atomic<uint64_t>& made) {
    const Instance& instance = scene.instances[index];
    const Mesh& mesh = scene.meshes[size_t(instance.mesh)];
    const std::vector<glm::vec3> placed = scene::positions_in_frame(scene, instance, frame);
    const float side = scene::is_mirrored(instance) ? -1.0f : 1.0f;
    const Cutter blank = blank_cutter(scene, index, frame, max_edge, walls, emission, lamps, made);
    std::vector<Cutter> runs((mesh.triangles.size() + run_length - 1) / run_length, blank);
    tbb::parallel_for(size_t(0), runs.size(), [&](size_t run) {
        Cutter& cutter = runs[run];
        const size_t end = std::min(mesh.triangles.size(), (run + 1) * run_length);
        for (size_t t = run * run_length; t < end; ++t) {
            const glm::uvec3 v = mesh.triangles[t];
            const glm::vec3 a = placed[v.x], b = placed[v.y], c = placed[v.z];
            const std::optional<glm::vec3> normal = normal_of(a, b, c);
            if (!normal) {
                cutter.roots.emplace_back();
                continue;
            }
            cutter.source.triangle = uint32_t(t);
            cutter.source.normal = side * *normal;
            cutter.cut({Corner{a, {0, 0}}, Corner{b, {1, 0}}, Corner{c, {0, 1}}});
        }
    });
    return runs;
}

/// Of the roles that `is_there` tells.
std::vector<std::vector<Cutter>> cut_scene(const Scene& scene, const scene::Frame& frame,
                                           float max_edge, const Walls* walls,
                                           bool (*is_there)(Role)) {
    std::vector<std::vector<Cutter>> parts(scene.instances.size());
    std::atomic<uint64_t> made = 0;
    // What does not light is asked for its cover alone.
    const std::optional<scene::EmissionMaps> emission =
        walls ? std::optional<scene::EmissionMaps>(scene) : std::nullopt;
    const std::vector<LampBox> lamps = walls ? lamp_boxes(scene, frame) : std::vector<LampBox>{};
    tbb::parallel_for(size_t(0), parts.size(), [&](size_t i) {
        if (is_there(scene.instances[i].role))
            parts[i] = cut_instance(scene, uint32_t(i), frame, max_edge, walls,
                                    emission ? &*emission : nullptr, lamps, made);
    });
    return parts;
}

} // namespace

bool is_covered(const visibility::Visibility& visibility, glm::vec3 point, glm::vec3 normal) {
    return Walls{visibility}.cover(point, normal);
}

std::vector<Patch> make_patches(const Scene& scene, const scene::Frame& frame, float max_edge) {
    std::vector<Patch> patches;
    for (const std::vector<Cutter>& runs :
         cut_scene(scene, frame, max_edge, nullptr, scene::blocks))
        for (const Cutter& run : runs)
            patches.insert(patches.end(), run.patches.begin(), run.patches.end());
    return patches;
}

PatchCover cover_surfaces(const Scene& scene, const scene::Frame& frame,
                          const visibility::Visibility& visibility, float max_edge) {
    const Walls walls{visibility};
    std::vector<std::vector<Cutter>> parts = cut_scene(scene, frame, max_edge, &walls, acts);
    PatchCover cover;
    PatchTree& tree = cover.tree;
    struct Run {
        Cutter* cut;
        size_t root, piece, node, patch; ///< where its own begin among all
    };
    std::vector<Run> runs;
    Run next{};
    for (std::vector<Cutter>& part : parts) {
        tree.first_root.push_back(next.root);
        for (Cutter& cut : part) {
            next.cut = &cut;
            runs.push_back(next);
            next.root += cut.roots.size();
            next.piece += cut.pieces.size();
            next.node += cut.nodes.size();
            next.patch += cut.patches.size();
        }
    }
    tree.roots.resize(next.root);
    tree.pieces.resize(next.piece);
    tree.nodes.resize(next.node);
    cover.patches.resize(next.patch);
    tbb::parallel_for(size_t(0), runs.size(), [&](size_t i) {
        const Run& run = runs[i];
        const Cutter cut = std::move(*run.cut); // its memory is given back on the way
        const auto moved = [&](PatchTree::Node node) {
            if (node.at != PatchTree::none)
                node.at += uint32_t(node.halved ? run.node : run.patch);
            return node;
        };
        const auto moved_root = [&](PatchTree::Root root) {
            if (root.first != PatchTree::none)
                root.first += uint32_t(run.piece);
            return root;
        };
        std::ranges::transform(cut.roots, tree.roots.data() + run.root, moved_root);
        std::ranges::transform(cut.pieces, tree.pieces.data() + run.piece, moved);
        std::ranges::transform(cut.nodes, tree.nodes.data() + run.node, moved);
        std::ranges::copy(cut.patches, cover.patches.data() + run.patch);
    });
    const auto receives = [](Role role) { return scene::is_asked(role) && !acts(role); };
    if (scene::any_of_role(scene, receives))
        for (const std::vector<Cutter>& part : cut_scene(scene, frame, max_edge, &walls, receives))
            for (const Cutter& cut : part)
                std::ranges::copy(cut.patches, std::back_inserter(cover.receivers));
    return cover;
}

/// The whole scene has a frame of 64 units, the few far triangles beside.
struct CutTrial::Impl {
    const Scene& scene;
    scene::Frame frame;
    visibility::Visibility visibility;
    scene::EmissionMaps emission;
    std::vector<LampBox> lamps;

    explicit Impl(const Scene& of)
        : scene(of),
          frame(frame_of(scene::trimmed_bounds(of, 0.01))),
          visibility(of, frame),
          emission(of),
          lamps(lamp_boxes(of, frame)) {}

    static scene::Frame frame_of(const Bounds& box) {
        const glm::dvec3 size = box.hi - box.lo;
        const double unit = std::max({size.x, size.y, size.z, 1e-6}) / 64.0;
        return {box.lo, unit, size / unit};
    }
};

CutTrial::CutTrial(const Scene& scene) : impl_(std::make_unique<Impl>(scene)) {}
CutTrial::~CutTrial() = default;

uint64_t CutTrial::count(const TrialPiece& piece, const scene::Frame& frame, float max_edge) const {
    const Scene& scene = impl_->scene;
    const Walls walls{impl_->visibility, float(frame.unit / impl_->frame.unit),
                      glm::vec3(impl_->frame.from_world(frame.origin)), true};
    std::atomic<uint64_t> made = 0;
    Cutter cutter = blank_cutter(scene, piece.instance, frame, max_edge, &walls, &impl_->emission,
                                 impl_->lamps, made);
    const Corners& at = piece.corners;
    const float side = scene::is_mirrored(scene.instances[piece.instance]) ? -1.0f : 1.0f;
    const std::optional<glm::vec3> normal = normal_of(at[0], at[1], at[2]);
    if (!normal)
        return 0;
    cutter.source.triangle = piece.triangle;
    cutter.source.normal = side * *normal;
    cutter.cut({Corner{at[0], piece.weights[0]}, Corner{at[1], piece.weights[1]},
                Corner{at[2], piece.weights[2]}});
    return made;
}

namespace {

/// Weights of a piece's three corners.
struct Weights {
    float a, b, c;

    void turn(unsigned by) {
        const float w[5] = {a, b, c, a, b};
        a = w[by];
        b = w[by + 1];
        c = w[by + 2];
    }
    /// Goes to the half that the point lies in; true: the second. Which it is nobody can predict:
    /// no branch.
    bool halve() {
        const bool second = b < a;
        const float twice = 2.0f * std::min(a, b), rest = std::abs(b - a), apex = c;
        a = second ? apex : rest;
        b = second ? rest : apex;
        c = twice;
        return second;
    }
};

/// Four hits' at once: a lane each.
struct FourWeights {
    using Floats = float __attribute__((vector_size(16)));
    using Words = int32_t __attribute__((vector_size(16)));
    Floats a{}, b{}, c{};
    Words piece{}, levels{};

    static Floats where(Words is, Floats yes, Floats no) {
        return Floats((is & Words(yes)) | (~is & Words(no)));
    }
    /// Weights::halve() for the lanes that have so many levels, to the bit.
    void halve(int level) {
        const Words open = level < levels, second = b < a;
        const Floats low = where(second, b, a), high = where(second, a, b);
        const Floats rest = high - low, apex = c;
        a = where(open, where(second, apex, rest), a);
        b = where(open, where(second, rest, apex), b);
        c = where(open, low + low, c);
        piece = (open & (piece + piece - second)) | (~open & piece);
    }
};

} // namespace

void PatchTree::approach(std::span<const visibility::Hit> hits, std::span<Approach> result) const {
    constexpr size_t lanes = 4;
    for (size_t first = 0; first < hits.size(); first += lanes) {
        const size_t count = std::min(lanes, hits.size() - first);
        FourWeights four;
        std::array<uint32_t, lanes> begins;
        int most = 0;
        for (size_t i = 0; i < count; ++i) {
            const visibility::Hit& hit = hits[first + i];
            const Root root =
                hit.instance == visibility::no_hit || hit.facing == visibility::Facing::back
                    ? Root{}
                    : roots[first_root[hit.instance] + hit.triangle];
            Weights w{1.0f - hit.barycentric.x - hit.barycentric.y, hit.barycentric.x,
                      hit.barycentric.y};
            w.turn(root.turn);
            four.a[i] = w.a;
            four.b[i] = w.b;
            four.c[i] = w.c;
            four.levels[i] = root.levels;
            begins[i] = root.first;
            most = std::max(most, int(root.levels));
        }
        for (int level = 0; level < most; ++level)
            four.halve(level);
        for (size_t i = 0; i < count; ++i)
            result[first + i] = begins[i] == none
                                    ? Approach{}
                                    : Approach{&pieces[begins[i] + uint32_t(four.piece[i])],
                                               {four.a[i], four.b[i], four.c[i]}};
    }
}

PatchTree::Approach PatchTree::approach(const visibility::Hit& hit) const {
    if (hit.instance == visibility::no_hit)
        return {};
    const Root root = roots[first_root[hit.instance] + hit.triangle];
    if (root.first == none)
        return {};
    Weights w{1.0f - hit.barycentric.x - hit.barycentric.y, hit.barycentric.x, hit.barycentric.y};
    w.turn(root.turn);
    uint32_t piece = 0;
    for (unsigned i = 0; i < root.levels; ++i)
        piece = 2 * piece + uint32_t(w.halve());
    return {&pieces[root.first + piece], {w.a, w.b, w.c}};
}

const PatchTree::Node* PatchTree::arrive(const Approach& from, glm::vec2& weights) const {
    const Node* node = from.piece;
    if (!node)
        return nullptr;
    Weights w{from.weights[0], from.weights[1], from.weights[2]};
    while (node->halved) {
        w.turn(node->turn);
        node = &nodes[node->at + uint32_t(w.halve())];
    }
    weights = {w.b, w.c};
    return node;
}

const PatchTree::Node* PatchTree::leaf(const visibility::Hit& hit, glm::vec2& weights) const {
    return arrive(approach(hit), weights);
}

} // namespace lpvbake::surface
