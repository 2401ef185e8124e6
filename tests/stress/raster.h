// Triangles through the kernels as a frame sends them, without a frame: clusters, selection, jobs, masks.
#pragma once

#include "tests/kernels/fixture.h"
#include "tests/stress/oracle.h"

#include <array>
#include <vector>

namespace nusselt::test {

struct Soup {
    std::vector<std::array<float, 3>> points;
    std::vector<std::array<uint32_t, 3>> triangles; // equal numbers share edges
    bool two_sided = true;
};

Corners corners_of(const Soup& soup, size_t triangle);

using Masks = std::vector<uint8_t>; // 16 of them, one after the other

struct RasterOptions {
    bool cull = true;          // cluster selection and horizon, as in a frame; else every triangle goes in
    uint32_t per_cluster = 64; // triangles at most
    float horizon = -1;        // tangent of the elevation below which culling drops; negative: the table's
    bool last_samples = false; // decided by the triangles' own planes where a mask is nearly closed
};

// As runtime/src/clusters.cpp makes them; `limit`: triangles of one.
std::vector<ClusterInput> clusters_of(const Soup& soup, uint32_t limit);

// The widest instruction set of this machine.
const kernels::Kernels& widest();

Masks rasterize(const kernels::Kernels& set, const kernels::MaskLayout& layout, const kernels::Batch& batch,
                const Soup& soup, const RasterOptions& options = {});
// The same as free triangles (TriangleJobs).
Masks rasterize_free(const kernels::Kernels& set, const kernels::MaskLayout& layout,
                     const kernels::Batch& batch, const Soup& soup);
// The same by the oracle in double, lanes that are not valid left empty.
Masks rasterize_double(const Samples& samples, const kernels::MaskLayout& layout, const kernels::Batch& batch,
                       const Soup& soup);

// Sixteen receivers from positions and normals.
kernels::Batch batch_of(const std::vector<std::array<float, 3>>& positions,
                        const std::vector<std::array<float, 3>>& normals);

// An icosahedron subdivided 4^n, outside counter-clockwise, radius 1; turned at random.
Soup sphere_soup(uint32_t subdivisions, Random* turn);
// Each triangle as four, corners shared: both sides of an edge are split alike.
Soup subdivided(const Soup& soup);
// Triangles near the origin, of every size and shape down to slivers; none shares a corner.
Soup random_soup(Random& random, uint32_t count);

} // namespace nusselt::test
