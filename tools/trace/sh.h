// Spherical harmonics in double, written down independently of the library: the reference must not share its
// mistakes.
#pragma once

namespace nusselt::tools {

// The 25 real orthonormal basis functions without Condon-Shortley phase, index l (l + 1) + m, in unit
// direction (x, y, z).
void sh_basis(double x, double y, double z, double out[25]);

// Transfer of a vertex that sees the whole hemisphere about unit normal n, Lambert with albedo 1:
// the clamped cosine over pi.
void open_transfer(double nx, double ny, double nz, double out[25]);

} // namespace nusselt::tools
