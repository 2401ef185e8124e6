#include "meshes.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>

namespace nusselt::test {

namespace {

constexpr float pi = 3.14159265f;

float part(uint32_t i, uint32_t n) {
    return static_cast<float>(i) / static_cast<float>(n);
}

} // namespace

void TriangleMesh::triangle(uint32_t a, uint32_t b, uint32_t c) {
    indices.insert(indices.end(), {a, b, c});
}

void TriangleMesh::quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    triangle(a, b, c);
    triangle(a, c, d);
}

void TriangleMesh::append(const TriangleMesh& other, Vec3f offset) {
    const uint32_t first = static_cast<uint32_t>(positions.size());
    for (const Vec3f p : other.positions) {
        positions.push_back(p + offset);
    }
    for (const uint32_t i : other.indices) {
        indices.push_back(first + i);
    }
}

void TriangleMesh::flip() {
    for (size_t i = 0; i < indices.size(); i += 3) {
        std::swap(indices[i + 1], indices[i + 2]);
    }
}

TriangleMesh grid(uint32_t columns, uint32_t rows) {
    TriangleMesh m;
    m.name = "grid";
    for (uint32_t y = 0; y <= rows; ++y) {
        for (uint32_t x = 0; x <= columns; ++x) {
            const float u = part(x, columns), v = part(y, rows);
            m.positions.push_back({u, v, 0.05f * std::sin(9 * u) * std::cos(7 * v)});
        }
    }
    for (uint32_t y = 0; y < rows; ++y) {
        for (uint32_t x = 0; x < columns; ++x) {
            const uint32_t a = y * (columns + 1) + x, b = a + columns + 1;
            m.quad(a, a + 1, b + 1, b);
        }
    }
    return m;
}

TriangleMesh torus(uint32_t around, uint32_t across) {
    TriangleMesh m;
    m.name = "torus";
    for (uint32_t i = 0; i < around; ++i) {
        for (uint32_t j = 0; j < across; ++j) {
            const float a = 2 * pi * part(i, around), b = 2 * pi * part(j, across),
                        r = 1 + 0.4f * std::cos(b);
            m.positions.push_back({r * std::cos(a), r * std::sin(a), 0.4f * std::sin(b)});
        }
    }
    for (uint32_t i = 0; i < around; ++i) {
        for (uint32_t j = 0; j < across; ++j) {
            const uint32_t k = (i + 1) % around, l = (j + 1) % across;
            m.quad(i * across + j, k * across + j, k * across + l, i * across + l);
        }
    }
    return m;
}

TriangleMesh sphere(uint32_t around, uint32_t down) {
    TriangleMesh m;
    m.name = "sphere";
    m.positions.push_back({0, 0, 1});
    for (uint32_t j = 1; j < down; ++j) {
        for (uint32_t i = 0; i < around; ++i) {
            const float a = 2 * pi * part(i, around), b = pi * part(j, down);
            m.positions.push_back({std::sin(b) * std::cos(a), std::sin(b) * std::sin(a), std::cos(b)});
        }
    }
    m.positions.push_back({0, 0, -1});
    const uint32_t last = static_cast<uint32_t>(m.positions.size() - 1);
    const auto at = [&](uint32_t i, uint32_t j) { return 1 + (j - 1) * around + i % around; };
    for (uint32_t i = 0; i < around; ++i) {
        m.triangle(0, at(i, 1), at(i + 1, 1));
        for (uint32_t j = 1; j + 1 < down; ++j) {
            m.quad(at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
        }
        m.triangle(last, at(i + 1, down - 1), at(i, down - 1));
    }
    return m;
}

TriangleMesh bumpy_sphere(uint32_t around, uint32_t down) {
    TriangleMesh m = sphere(around, down);
    m.name = "bumpy sphere";
    for (Vec3f& p : m.positions) {
        p = p * (1 + 0.15f * std::sin(8 * p.x) * std::sin(7 * p.y + 1) * std::sin(9 * p.z));
    }
    return m;
}

TriangleMesh cube(bool split_normals) {
    TriangleMesh m;
    m.name = "cube";
    for (uint32_t i = 0; i < 8; ++i) {
        m.positions.push_back({i & 1 ? 1.0f : -1.0f, i & 2 ? 1.0f : -1.0f, i & 4 ? 1.0f : -1.0f});
    }
    const uint32_t faces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                  {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    const Vec3f normals[6] = {{0, 0, -1}, {0, 0, 1}, {0, -1, 0}, {0, 1, 0}, {-1, 0, 0}, {1, 0, 0}};
    if (!split_normals) {
        for (const auto& f : faces) {
            m.quad(f[0], f[1], f[2], f[3]);
        }
        return m;
    }
    TriangleMesh split;
    split.name = "split cube";
    for (uint32_t f = 0; f < 6; ++f) {
        for (const uint32_t v : faces[f]) {
            split.positions.push_back(m.positions[v]);
            split.normals.push_back(normals[f]);
        }
        split.quad(4 * f, 4 * f + 1, 4 * f + 2, 4 * f + 3);
    }
    return split;
}

TriangleMesh moebius(uint32_t around) {
    TriangleMesh m;
    m.name = "moebius";
    for (uint32_t i = 0; i < around; ++i) {
        const float a = 2 * pi * part(i, around), h = a / 2;
        for (const float s : {-0.3f, 0.3f}) {
            const float r = 1 + s * std::cos(h);
            m.positions.push_back({r * std::cos(a), r * std::sin(a), s * std::sin(h)});
        }
    }
    for (uint32_t i = 0; i < around; ++i) {
        const bool last = i + 1 == around; // half a turn: the two rims change places
        const uint32_t c = last ? 1 : 2 * i + 2, d = last ? 0 : 2 * i + 3;
        m.quad(2 * i, c, d, 2 * i + 1);
    }
    return m;
}

bool load_obj(const std::string& path, TriangleMesh& out) {
    std::ifstream file(path);
    if (!file) return false;
    out = {};
    out.name = path.substr(path.find_last_of('/') + 1);
    std::string line;
    while (std::getline(file, line)) {
        std::istringstream words(line);
        std::string word;
        words >> word;
        if (word == "v") {
            Vec3f p;
            words >> p.x >> p.y >> p.z;
            out.positions.push_back(p);
        } else if (word == "f") {
            std::vector<uint32_t> face;
            while (words >> word) {
                face.push_back(static_cast<uint32_t>(std::stoul(word)) - 1);
            }
            for (size_t i = 2; i < face.size(); ++i) {
                out.triangle(face[0], face[i - 1], face[i]);
            }
        }
    }
    return !out.indices.empty();
}

Built build(const TriangleMesh& mesh, const LevelOptions& options) {
    MeshDesc desc;
    desc.rest_positions = {mesh.positions.empty() ? nullptr : &mesh.positions[0].x, mesh.positions.size(),
                           12};
    if (!mesh.normals.empty()) desc.rest_normals = {&mesh.normals[0].x, mesh.normals.size(), 12};
    desc.indices = mesh.indices.data();
    desc.index_count = mesh.indices.size();
    Built out;
    build_mesh(desc, options, Allocator{}, out.data, out.info);
    return out;
}

std::vector<Triple> cluster_triples(const Clusters& clusters, uint32_t cluster) {
    std::vector<Triple> out;
    const uint32_t* vertices = clusters.vertices.data() + clusters.vertex_begin[cluster];
    for (uint32_t t = clusters.triangle_begin[cluster]; t < clusters.triangle_begin[cluster + 1]; ++t) {
        const ClusterTriangle& k = clusters.triangles[t];
        out.push_back({vertices[k.corner[0]], vertices[k.corner[1]], vertices[k.corner[2]]});
    }
    return out;
}

std::vector<Triple> level_triples(const Built& built, uint32_t level) {
    std::vector<Triple> out;
    const Clusters& c = built.data.clusters;
    for (uint32_t i = 0; i < c.count(); ++i) {
        if (c.level[i] != level) continue;
        const std::vector<Triple> own = cluster_triples(c, i);
        out.insert(out.end(), own.begin(), own.end());
    }
    return out;
}

uint32_t open_edges(const std::vector<Triple>& triangles) {
    std::map<std::pair<uint32_t, uint32_t>, std::pair<int, int>> edges; // along, against
    for (const Triple& t : triangles) {
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t a = t[k], b = t[(k + 1) % 3];
            auto& use = edges[std::minmax(a, b)];
            ++(a < b ? use.first : use.second);
        }
    }
    uint32_t open = 0;
    for (const auto& [edge, use] : edges) {
        open += use.first != use.second;
    }
    return open;
}

} // namespace nusselt::test
