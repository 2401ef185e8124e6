// Meshes for the tests, and what they ask of a build.
#pragma once

#include "runtime/src/levels.h"
#include "runtime/src/vec3.h"

#include <array>
#include <string>
#include <vector>

namespace nusselt::test {

struct TriangleMesh {
    std::string name;
    std::vector<Vec3f> positions;
    std::vector<Vec3f> normals; // may be empty
    std::vector<uint32_t> indices;

    void triangle(uint32_t a, uint32_t b, uint32_t c);
    void quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d);
    void append(const TriangleMesh& other, Vec3f offset = {});
    void flip();
};

TriangleMesh grid(uint32_t columns, uint32_t rows);        // open, in the plane z = 0 with soft bumps
TriangleMesh torus(uint32_t around, uint32_t across);      // closed, outward
TriangleMesh sphere(uint32_t around, uint32_t down);       // closed, poles as fans
TriangleMesh bumpy_sphere(uint32_t around, uint32_t down); // with folds of 15 %
TriangleMesh cube(bool split_normals);                     // 8 or 24 vertices
TriangleMesh moebius(uint32_t around);
bool load_obj(const std::string& path, TriangleMesh& out); // positions and faces

struct Built {
    MeshData data{Allocator{}};
    MeshInfo info;
};
Built build(const TriangleMesh& mesh, const LevelOptions& options = {});

using Triple = std::array<uint32_t, 3>;
std::vector<Triple> cluster_triples(const Clusters& clusters, uint32_t cluster); // welded
std::vector<Triple> level_triples(const Built& built, uint32_t level);           // welded

// Edges that are not used as often one way as the other.
uint32_t open_edges(const std::vector<Triple>& triangles);

} // namespace nusselt::test
