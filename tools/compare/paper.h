// Kautz, Lehtinen, Aila 2004, Hemispherical Rasterization for Self-Shadowing of Dynamic Objects: tables 1
// and 2. Measured there on one of two 3.06 GHz Pentium 4 Xeons; their scenes are not published, ours are made
// to their sizes.
#pragma once

#include <cstdint>
#include <string_view>

namespace nusselt::tools {

struct PaperRow {
    std::string_view name;
    uint32_t vertices, triangles, coarse_triangles;
    double rasterized;              // a receiver, without PVS
    double fps;                     // without PVS
    double rasterized_pvs, fps_pvs; // with PVS; 0: not given
    double error;                   // mean relative L2
    double shares[4];               // of the shadow loop: rasterization, integration, transform, other
};

constexpr PaperRow paper_rows[] = {
    {"cloth", 1378, 2560, 160, 236.4, 15.5, 0, 0, 0.0247, {0.480, 0.235, 0.265, 0.020}},
    {"fight", 2978, 4806, 444, 448.8, 4.9, 99.5, 9.5, 0.0793, {0.544, 0.194, 0.244, 0.018}},
    {"chess", 1897, 3704, 382, 378.8, 7.8, 73.9, 15.1, 0.0289, {0.520, 0.238, 0.219, 0.023}},
    {"hand", 8636, 15854, 378, 414.1, 2.6, 49.7, 6.1, 0.0382, {0.423, 0.352, 0.194, 0.031}},
};

inline const PaperRow* paper_row(std::string_view name) {
    for (const PaperRow& row : paper_rows)
        if (row.name == name) return &row;
    return nullptr;
}

} // namespace nusselt::tools
