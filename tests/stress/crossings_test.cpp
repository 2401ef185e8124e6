// Rays against closed meshes. How often a mesh winds around a receiver, by the kernels, which leave out
// triangles by spheres, by planes behind the origin and by where a plane is met; and by a count in double
// over every triangle, which leaves out none.
#include "tests/stress/ledger.h"
#include "tests/stress/raster.h"

#include "tools/load/model.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

namespace nusselt::test {

namespace {

using namespace kernels;

namespace fs = std::filesystem;

using Vec = std::array<double, 3>;

double dot(const Vec& a, const Vec& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Vec minus(const Vec& a, const Vec& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
Vec cross(const Vec& a, const Vec& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double length(const Vec& a) {
    return std::sqrt(dot(a, a));
}
Vec in_double(const float* p) {
    return {p[0], p[1], p[2]};
}

// Parallel rays from the batch's positions, as the runtime makes them.
Rays rays_along(const Batch& batch, const Vec& direction) {
    Rays rays{};
    std::copy_n(&batch.position[0][0], 3 * lanes, &rays.origin[0][0]);
    std::copy_n(batch.bounds.centre, 3, rays.centre);
    rays.radius = batch.bounds.radius;
    rays.active = batch.valid;
    size_t least = 0;
    for (size_t i = 1; i < 3; ++i)
        least = std::fabs(direction[i]) < std::fabs(direction[least]) ? i : least;
    Vec first{};
    first[(least + 1) % 3] = direction[(least + 2) % 3];
    first[(least + 2) % 3] = -direction[(least + 1) % 3];
    const double size = length(first);
    for (double& c : first)
        c /= size;
    const Vec second = cross(direction, first);
    for (size_t i = 0; i < 3; ++i) {
        rays.direction[i] = float(direction[i]);
        rays.across[0][i] = float(first[i]);
        rays.across[1][i] = float(second[i]);
    }
    return rays;
}

// How near the ray through (0, 0) passes to a projected triangle; 0 inside.
double distance_to(const double (&u)[3], const double (&v)[3]) {
    double least = 1e30;
    uint32_t left = 0;
    for (size_t k = 0; k < 3; ++k) {
        const size_t n = (k + 1) % 3;
        const double x = u[n] - u[k], y = v[n] - v[k], square = x * x + y * y;
        const double at = square > 0 ? std::clamp(-(u[k] * x + v[k] * y) / square, 0.0, 1.0) : 0;
        least = std::min(least, std::hypot(u[k] + at * x, v[k] + at * y));
        left += u[k] * v[n] - v[k] * u[n] > 0;
    }
    return left == 0 || left == 3 ? 0 : least;
}

// What every triangle adds to a ray's count, without a look at anything else. Empty where rounding may decide
// one: the ray passes within 4e-6 of a triangle (of a frame's extent) that is so edge-on to it, or whose
// plane passes the origin so near, that floats do not know which way it faces or on which side it lies.
// Narrow ones have normals that are worse by as much as they are narrow. A triangle that has the origin as
// its corner does not count, because its plane passes it; edge-on it leaves open whether the one behind it is
// met.
std::optional<int32_t> brute_winding(const Soup& soup, const Rays& rays, uint32_t lane) {
    constexpr double rounding = 4e-6;
    const Vec origin{rays.origin[0][lane], rays.origin[1][lane], rays.origin[2][lane]};
    const Vec across[2] = {in_double(rays.across[0]), in_double(rays.across[1])};
    int32_t winding = 0;
    for (const auto& t : soup.triangles) {
        Vec p[3];
        double u[3], v[3];
        for (size_t k = 0; k < 3; ++k) {
            p[k] = minus(in_double(soup.points[t[k]].data()), origin);
            u[k] = dot(p[k], across[0]);
            v[k] = dot(p[k], across[1]);
        }
        const auto away = [](const double(&x)[3]) {
            return std::min({x[0], x[1], x[2]}) > rounding || std::max({x[0], x[1], x[2]}) < -rounding;
        };
        if (away(u) || away(v)) continue;
        const Vec normal = cross(minus(p[1], p[0]), minus(p[2], p[0]));
        const double area = length(normal);
        if (area == 0) continue;
        const double height = -dot(normal, p[0]) / area;
        double longest = 0, longest_seen = 0;
        for (size_t k = 0; k < 3; ++k) {
            const size_t n = (k + 1) % 3;
            longest = std::max(longest, length(minus(p[n], p[k])));
            longest_seen = std::max(longest_seen, std::hypot(u[n] - u[k], v[n] - v[k]));
        }
        const double seen = std::fabs((u[1] - u[0]) * (v[2] - v[0]) - (v[1] - v[0]) * (u[2] - u[0]));
        const double narrow = longest * longest / area; // length over height
        if (p[0] == Vec{} || p[1] == Vec{} || p[2] == Vec{}) {
            if (seen < rounding * longest_seen || 1e-7 * narrow * longest > rounding / 2) return std::nullopt;
            continue;
        }
        if (distance_to(u, v) < rounding &&
            (std::fabs(height) < 2 * rounding + 1e-6 * narrow || seen < rounding * longest_seen))
            return std::nullopt;
        uint32_t left = 0;
        for (size_t k = 0; k < 3; ++k) {
            const size_t n = (k + 1) % 3;
            const double side = u[k] * v[n] - v[k] * u[n];
            left += side > 0 || (side == 0 && (u[k] < u[n] || (u[k] == u[n] && v[k] < v[n])));
        }
        winding += left == 3 && height < 0 ? 1 : left == 0 && height > 0 ? -1 : 0;
    }
    return winding;
}

struct Compared {
    uint64_t rays = 0, grazing = 0, crossed = 0, wrong = 0;
};

// Sixteen rays a time from everywhere around and on the mesh, along the axes, as a frame sends them first,
// and anywhere, as the samples that it asks next.
void compare(const Soup& soup, const std::vector<ClusterInput>& clusters, Random& random, uint32_t batches,
             Compared& sum) {
    std::array<float, 3> low{1, 1, 1}, high{-1, -1, -1};
    for (const auto& p : soup.points) {
        for (size_t k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], p[k]);
            high[k] = std::max(high[k], p[k]);
        }
    }
    auto values = aligned_array<float>(4 * (clusters.size() + 16));
    float* const spheres[4] = {&values[0], &values[clusters.size() + 16], &values[2 * (clusters.size() + 16)],
                               &values[3 * (clusters.size() + 16)]};
    for (size_t c = 0; c < clusters.size(); ++c) {
        for (size_t k = 0; k < 3; ++k)
            spheres[k][c] = clusters[c].view.centre[k];
        spheres[3][c] = clusters[c].view.radius;
    }
    ClusterBounds bounds{};
    std::copy_n(spheres, 3, bounds.centre);
    bounds.radius = spheres[3];
    std::vector<uint32_t> selected(clusters.size() + 16);
    for (uint32_t b = 0; b < batches; ++b) {
        std::vector<std::array<float, 3>> at(16), up(16);
        const uint32_t from = random.below(3);
        for (uint32_t lane = 0; lane < 16; ++lane) {
            random.direction(up[lane].data());
            const auto& t = soup.triangles[random.below(uint32_t(soup.triangles.size()))];
            if (from == 0) { // around and within
                for (size_t k = 0; k < 3; ++k)
                    at[lane][k] = low[k] + (high[k] - low[k]) * random.between(-0.1f, 1.1f);
            } else if (from == 1) { // a vertex
                at[lane] = soup.points[t[random.below(3)]];
            } else { // about the surface
                const float off = std::pow(10.0f, random.between(-4, -1)), x = random.between(0, 1);
                for (size_t k = 0; k < 3; ++k)
                    at[lane][k] = (1 - x) * soup.points[t[0]][k] +
                                  x * (0.5f * soup.points[t[1]][k] + 0.5f * soup.points[t[2]][k]) +
                                  off * up[lane][k];
            }
        }
        const Batch batch = batch_of(at, up);
        Vec direction{};
        if (random.one_in(2)) {
            direction[random.below(3)] = random.one_in(2) ? 1 : -1;
        } else {
            float d[3];
            random.direction(d);
            direction = in_double(d);
        }
        const Rays rays = rays_along(batch, direction);
        int32_t got[lanes] = {};
        const uint32_t count =
            widest().select_along(rays, bounds, nullptr, 0, uint32_t(clusters.size()), selected.data());
        for (uint32_t i = 0; i < count; ++i)
            widest().count_crossings(rays, clusters[selected[i]].view, clusters[selected[i]].points.get(),
                                     got);
        for (uint32_t lane = 0; lane < lanes; ++lane) {
            const std::optional<int32_t> expected = brute_winding(soup, rays, lane);
            ++sum.rays;
            sum.grazing += !expected;
            sum.crossed += expected && *expected != 0;
            if (expected && *expected != got[lane]) {
                ++sum.wrong;
                ADD_FAILURE() << "batch " << b << ", lane " << lane << ": " << got[lane] << " for "
                              << *expected;
                if (sum.wrong > 20) return;
            }
        }
    }
}

// A torus of random, closed at both seams.
Soup torus_soup(Random& random) {
    const uint32_t around = 3 + random.below(30), across = 3 + random.below(20);
    Soup soup;
    const float thin = random.between(0.02f, 0.5f);
    for (uint32_t i = 0; i < around; ++i) {
        for (uint32_t j = 0; j < across; ++j) {
            const float a = 6.2831853f * float(i) / float(around), b = 6.2831853f * float(j) / float(across),
                        r = 0.7f + thin * std::cos(b);
            soup.points.push_back({r * std::cos(a), r * std::sin(a), thin * std::sin(b)});
            const uint32_t next_i = (i + 1) % around, next_j = (j + 1) % across;
            const uint32_t p = i * across + j, q = next_i * across + j, s = next_i * across + next_j,
                           t = i * across + next_j;
            soup.triangles.push_back({p, q, s});
            soup.triangles.push_back({p, s, t});
        }
    }
    return soup;
}

// Closed, and then bent out of shape: dented until it passes through itself, flattened to a thousandth, with
// corners pulled across it so that triangles lie folded and long, and small and far from the frame's middle.
Soup bent_soup(Random& random) {
    Soup soup = random.one_in(2) ? torus_soup(random) : sphere_soup(random.below(4), &random);
    soup.two_sided = false;
    const float dents = random.one_in(2) ? random.between(0, 1.5f) : 0;
    const uint32_t pulled = random.one_in(3) ? 1 + random.below(4) : 0;
    const float flat = random.one_in(3) ? std::pow(10.0f, random.between(-3, 0)) : 1;
    const float size = random.one_in(3) ? std::pow(10.0f, random.between(-2, 0)) : 0.5f;
    float away[3];
    random.direction(away);
    for (auto& p : soup.points) {
        const float by = 1 + dents * random.between(-1, 1);
        for (float& c : p)
            c *= by;
    }
    for (uint32_t i = 0; i < pulled; ++i)
        random.direction(soup.points[random.below(uint32_t(soup.points.size()))].data());
    float most = 0;
    for (auto& p : soup.points) {
        p[2] *= flat;
        most = std::max(most, std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]));
    }
    for (auto& p : soup.points) {
        for (size_t k = 0; k < 3; ++k)
            p[k] = p[k] * (size / most) + away[k] * (0.999f - size);
    }
    return soup;
}

TEST(Crossings, OfBentMeshes) {
    Compared sum;
    for (uint64_t i = 0; i < stress_cases() / 2 && sum.wrong < 20; ++i) {
        Random random(stress_seed() * 1000003 + i + (10u << 20));
        const Soup soup = bent_soup(random);
        SCOPED_TRACE("case " + std::to_string(i));
        compare(soup, clusters_of(soup, 1 + random.below(64)), random, 4, sum);
    }
    figure("rays counted by the kernels and without filters, bent meshes", double(sum.rays), "rays");
    figure("rays of these that rounding may decide", 100 * double(sum.grazing) / double(sum.rays), "%");
    EXPECT_GT(sum.crossed, sum.rays / 8);
    EXPECT_LT(sum.grazing, sum.rays / 10);
}

// Axis-parallel boxes in a lattice, receivers on it: rays along walls, through edges and corners.
TEST(Crossings, OfBoxesOnALattice) {
    Compared sum;
    for (uint64_t i = 0; i < stress_cases() / 2 && sum.wrong < 20; ++i) {
        Random random(stress_seed() * 1000003 + i + (11u << 20));
        Soup soup;
        const uint32_t boxes = 1 + random.below(6);
        for (uint32_t box = 0; box < boxes; ++box) {
            const auto first = uint32_t(soup.points.size());
            float low[3], high[3];
            for (size_t k = 0; k < 3; ++k) {
                low[k] = float(random.below(8)) / 8 - 0.5f;
                high[k] = low[k] + float(1 + random.below(4)) / 8;
            }
            for (uint32_t c = 0; c < 8; ++c)
                soup.points.push_back(
                    {c & 1 ? high[0] : low[0], c & 2 ? high[1] : low[1], c & 4 ? high[2] : low[2]});
            constexpr uint32_t faces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                              {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
            for (const auto& f : faces) {
                soup.triangles.push_back({first + f[0], first + f[1], first + f[2]});
                soup.triangles.push_back({first + f[0], first + f[2], first + f[3]});
            }
        }
        SCOPED_TRACE("case " + std::to_string(i));
        compare(soup, clusters_of(soup, 64), random, 4, sum);
    }
    EXPECT_GT(sum.crossed, sum.rays / 16);
    EXPECT_LT(sum.grazing, sum.rays / 3); // receivers in the planes of other walls
}

TEST(Crossings, OfRealModels) {
    const fs::path models = fs::path(NUSSELT_SHARED_DIR) / "data/models";
    if (!fs::exists(models)) GTEST_SKIP() << "not here: " << models;
    Compared sum;
    for (const char* name :
         {"classic/armadillo/armadillo.obj", "classic/spot_cow/spot.obj",
          "classic/stanford_bunny/bunny_72k.glb", "classic/nefertiti/nefertiti-lowres.obj",
          "classic/lucy/lucy.glb", "static/chess_board/chess-board.glb",
          "rigid/cesium_milk_truck/CesiumMilkTruck.glb", "rigid/kenney_character/character.glb",
          "skinned/kaykit_knight/Knight.glb", "skinned/mannequiny/mannequiny.glb"}) {
        const load::LoadResult loaded = load::load_model((models / name).string());
        ASSERT_TRUE(loaded.ok) << name;
        SCOPED_TRACE(name);
        Soup soup;
        soup.two_sided = false;
        float low[3] = {1e30f, 1e30f, 1e30f}, high[3] = {-1e30f, -1e30f, -1e30f};
        for (const scenes::Mesh& mesh : loaded.model.meshes) {
            const auto first = uint32_t(soup.points.size());
            for (const glm::vec3& p : mesh.rest_positions) {
                soup.points.push_back({p.x, p.y, p.z});
                for (int k = 0; k < 3; ++k) {
                    low[k] = std::min(low[k], p[k]);
                    high[k] = std::max(high[k], p[k]);
                }
            }
            for (size_t i = 0; i + 2 < mesh.indices.size(); i += 3)
                soup.triangles.push_back(
                    {first + mesh.indices[i], first + mesh.indices[i + 1], first + mesh.indices[i + 2]});
        }
        // As a frame: about the middle, by a power of two, at most 1 in size.
        const float extent = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
        const float scale = std::exp2(-std::ceil(std::log2(extent)));
        for (auto& p : soup.points) {
            for (size_t k = 0; k < 3; ++k)
                p[k] = (p[k] - (low[k] + high[k]) / 2) * scale;
        }
        Random random(stress_seed() + 71);
        const auto batches =
            uint32_t(stress_cases() * 1000 / soup.triangles.size() + 2); // about as long for each
        Compared one;
        compare(soup, clusters_of(soup, 64), random, batches, one);
        EXPECT_GT(one.crossed, one.rays / 50);
        EXPECT_LT(one.grazing, one.rays / 4);
        sum.rays += one.rays;
        sum.grazing += one.grazing;
    }
    figure("rays counted by the kernels and without filters, real models", double(sum.rays), "rays");
    figure("rays of these that rounding may decide, real models",
           100 * double(sum.grazing) / double(sum.rays), "%");
}

} // namespace

} // namespace nusselt::test
