// What the opaque VisibleSet holds.
#pragma once

#include "frame_data.h"
#include "nusselt/visible_set.h"

namespace nusselt {

// Of one mesh as receiver: its batches are those of its receivers, then those of its duplicates. Both sides
// of a vertex share a row.
struct VisibleRows {
    uint64_t identity; // of the mesh
    uint32_t first_row, first_own_row;
    bool has_back; // recorded frames had results of both sides
};

struct VisibleSet {
    explicit VisibleSet(const Allocator& a)
        : meshes(HostAllocator<VisibleRows>(a)), bits(HostAllocator<uint32_t>(a)) {}

    Quality quality = Quality::standard;
    uint32_t segments = 0, rows = 0, clusters = 0;
    uint32_t words = 0; // of a row: one bit a cluster, in the order of a frame of these meshes
    bool recorded = false, watertight = false; // by some frame; recorded frames were watertight
    Vector<VisibleRows> meshes;
    Vector<uint32_t> bits; // by segment, then by batch
};

inline const uint32_t* visible_row(const VisibleSet& set, uint32_t segment, uint32_t row) {
    return set.bits.data() + (size_t(segment) * set.rows + row) * set.words;
}
inline uint32_t* visible_row(VisibleSet& set, uint32_t segment, uint32_t row) {
    return set.bits.data() + (size_t(segment) * set.rows + row) * set.words;
}

// Of everything that a set depends on: the receivers' order and the clusters of all levels.
uint64_t mesh_identity(const MeshData& mesh);

// What does not fit of a frame and the set that it reads or records; of its m-th mesh.
Status check_visible_set(const FrameDesc& desc);
Status check_visible_meshes(const FrameDesc& desc, uint32_t m, const MeshData& mesh);

// A set takes the kind of its first recorded frame, which all others must be of; the context's guard is held.
void begin_recording(const FrameDesc& desc);

// Of worker.candidates those that ever matter to receivers of these rows, to worker.visible; returns how
// many.
uint32_t keep_visible(const Frame& frame, const uint32_t* rows, uint32_t count, uint32_t candidates,
                      Worker& worker);

// Notes a cluster, drawn just now, for the receivers whose masks it changed (worker.masks_before).
void record_visible(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t cluster,
                    uint32_t valid, Worker& worker);

} // namespace nusselt
