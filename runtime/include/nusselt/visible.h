// Which vertices a picture needs: receivers that no camera sees don't have to be computed.
#pragma once

#include "nusselt/status.h"
#include "nusselt/views.h"

#include <cstddef>
#include <cstdint>

namespace nusselt {

struct Camera {
    // Row-major; (x, y, z, w) of the clip space = clip_from_position * (position, 1). The picture is where
    // w > 0 and -w <= x, y <= w. Depth is not looked at, so any convention of z will do.
    float clip_from_position[16] = {};
    // Where it stands, in the space of the positions, and 1; of a parallel projection the direction towards
    // the viewer, and 0.
    float eye[4] = {};
    // How far beyond the picture's edge a triangle still counts, in half widths and half heights of the
    // picture. Above 0 where the mask is made before the camera's last move.
    float margin = 0;
    bool back_faces = false; // triangles seen from behind count too: what is drawn without culling
};

// Sets the bits (FrameMesh::needed) of the corners of all triangles that face the camera and aren't wholly
// beside its picture; clears none, so several cameras may be joined. Zero the mask first. Occlusion is not
// looked at. In doubt a triangle counts: edge-on, across the eye's plane, or with a corner that is not
// finite. `indices` as in MeshDesc (counter-clockwise seen from outside), `positions` those of the frame,
// `needed` (positions.count + 31) / 32 words. Some 20 ns a triangle, on the calling thread, without memory of
// its own. `invalid_argument`: null pointers, a stride or a count that does not fit, an index out of range;
// no bit is changed.
Status mark_visible(const Camera& camera, Vec3View positions, const uint32_t* indices, size_t index_count,
                    uint32_t* needed);

} // namespace nusselt
