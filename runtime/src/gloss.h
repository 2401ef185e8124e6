// Glossy transfer and direct light of a batch, for the outputs that ask for them.
#pragma once

#include "frame_data.h"

namespace nusselt {

Status check_gloss(const Gloss& gloss);
// Whether the batch's masks are needed for it, not its transfer vectors alone.
bool is_from_masks(OutputKind kind, const Gloss* gloss);

// Fills worker.glossy (the caller's space) from the batch's masks and worker.local, which it fills too where
// all results are made from masks. Where the mesh has no gloss it is the diffuse transfer. Returns how many
// channels differ: 1 where all are grey.
uint32_t make_glossy(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                     const kernels::Batch& batch, Worker& worker);

// Radiance straight from the masks and the frame's environment.
void make_direct(const Frame& frame, const MeshSlice& slice, const uint32_t* receivers, uint32_t count,
                 const kernels::Batch& batch, const Worker& worker, float rgb[3][kernels::lanes]);

} // namespace nusselt
