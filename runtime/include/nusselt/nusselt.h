// nusselt: soft, directional self-shadows for deforming meshes, on the CPU, every frame.
//
// Conventions, everywhere:
//  space      right-handed, axes as the caller has them (no axis is special), any unit of length; all
//             meshes of a frame in one common space, results in that space
//  winding    counter-clockwise triangles face outward, as in glTF
//  SH         real, orthonormal, no Condon-Shortley phase, degree 4: 25 terms, index l (l + 1) + m
//             (Y_1,-1 ~ y, Y_1,0 ~ z, Y_1,1 ~ x)
//  transfer   V_i = integral over the sphere of b_i(s) V(s) f_r max(0, n.s) ds, with V(s) = 1 where the
//             environment is seen, and Lambert f_r = 1 / pi (albedo 1); radiance out = sum over i of L_i V_i
//             (Kautz, Lehtinen, Aila 2004, equations 2 and 3)
//  mask       a set bit is blocked. 16-bit words in order, one per 4x4 block of cells, 4 rows of 4 bits.
//             Quality paper: blocks row by row of the square around the disk. Else parts, row by row each,
//             that are one set of cells turned about the normal: of 1024 bits the halves y < 0 and y > 0,
//             each from the middle outwards; of 4096 the quarters x, y < 0, then y < 0 < x, x, y > 0 and
//             x < 0 < y
//  results    same input, same bits: for any thread count, executor and instruction set
//
// Limits: distant light, no inter-reflection, one visibility sample per vertex (a shadow is as fine as the
// mesh).
#pragma once

#include "nusselt/allocator.h"
#include "nusselt/clock.h"
#include "nusselt/context.h"
#include "nusselt/environment.h"
#include "nusselt/executor.h"
#include "nusselt/frame.h"
#include "nusselt/gloss.h"
#include "nusselt/history.h"
#include "nusselt/lighting.h"
#include "nusselt/mesh.h"
#include "nusselt/output.h"
#include "nusselt/profiler.h"
#include "nusselt/status.h"
#include "nusselt/version.h"
#include "nusselt/views.h"
#include "nusselt/visible.h"
#include "nusselt/visible_set.h"
