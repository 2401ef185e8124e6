#include "tools/trace/sh.h"

namespace nusselt::tools {

void sh_basis(double x, double y, double z, double out[25]) {
    const double x2 = x * x, y2 = y * y, z2 = z * z;
    // Normalisation sqrt((2 l + 1) / (4 pi) (l - |m|)! / (l + |m|)!), times sqrt 2 where m != 0, times the
    // polynomial's own factor.
    out[0] = 0.28209479177387814;
    out[1] = 0.48860251190291992 * y;
    out[2] = 0.48860251190291992 * z;
    out[3] = 0.48860251190291992 * x;
    out[4] = 1.0925484305920792 * x * y;
    out[5] = 1.0925484305920792 * y * z;
    out[6] = 0.31539156525252005 * (3 * z2 - 1);
    out[7] = 1.0925484305920792 * x * z;
    out[8] = 0.54627421529603959 * (x2 - y2);
    out[9] = 0.59004358992664352 * y * (3 * x2 - y2);
    out[10] = 2.8906114426405538 * x * y * z;
    out[11] = 0.45704579946446572 * y * (5 * z2 - 1);
    out[12] = 0.37317633259011540 * z * (5 * z2 - 3);
    out[13] = 0.45704579946446572 * x * (5 * z2 - 1);
    out[14] = 1.4453057213202769 * z * (x2 - y2);
    out[15] = 0.59004358992664352 * x * (x2 - 3 * y2);
    out[16] = 2.5033429417967046 * x * y * (x2 - y2);
    out[17] = 1.7701307697799304 * y * z * (3 * x2 - y2);
    out[18] = 0.94617469575756008 * x * y * (7 * z2 - 1);
    out[19] = 0.66904654355728921 * y * z * (7 * z2 - 3);
    out[20] = 0.10578554691520431 * (35 * z2 * z2 - 30 * z2 + 3);
    out[21] = 0.66904654355728921 * x * z * (7 * z2 - 3);
    out[22] = 0.47308734787878004 * (x2 - y2) * (7 * z2 - 1);
    out[23] = 1.7701307697799304 * x * z * (x2 - 3 * y2);
    out[24] = 0.62583573544917614 * (x2 * x2 - 6 * x2 * y2 + y2 * y2);
}

void open_transfer(double nx, double ny, double nz, double out[25]) {
    // Funk-Hecke: the clamped cosine's coefficient of each degree, over pi.
    constexpr double degree[5] = {1, 2.0 / 3, 1.0 / 4, 0, -1.0 / 24};
    sh_basis(nx, ny, nz, out);
    for (int i = 0; i < 25; ++i)
        out[i] *= degree[(i > 0) + (i > 3) + (i > 8) + (i > 15)];
}

} // namespace nusselt::tools
