// Spherical harmonics of degree 4 as formulas over any arithmetic type (float, double, a SIMD vector), so that every
// instruction set does the same operations in the same order. Real, orthonormal, no Condon-Shortley phase.
// Included inside a namespace, once for each instruction set: no guard, no namespace, no includes of its own.

// The 25 basis functions in unit direction (x, y, z). `k` turns a double into T.
template<class T, class Constant>
inline void sh_basis(const Constant& k, const T x, const T y, const T z, T out[25]) {
    const T xx = x * x, yy = y * y, zz = z * z;
    const T xy = x * y, yz = y * z, xz = x * z;
    const T d = xx - yy;                       // r^2 cos 2p
    const T c3 = x * (xx - k(3.0) * yy);       // r^3 cos 3p
    const T s3 = y * (k(3.0) * xx - yy);       // r^3 sin 3p
    const T q5 = k(5.0) * zz - k(1.0);
    const T q7 = k(7.0) * zz - k(1.0);
    const T r7 = k(7.0) * zz - k(3.0);
    out[0] = k(0.28209479177387814);
    out[1] = k(0.4886025119029199) * y;
    out[2] = k(0.4886025119029199) * z;
    out[3] = k(0.4886025119029199) * x;
    out[4] = k(1.0925484305920792) * xy;
    out[5] = k(1.0925484305920792) * yz;
    out[6] = k(0.31539156525252005) * (k(3.0) * zz - k(1.0));
    out[7] = k(1.0925484305920792) * xz;
    out[8] = k(0.5462742152960396) * d;
    out[9] = k(0.5900435899266435) * s3;
    out[10] = k(2.890611442640554) * (xy * z);
    out[11] = k(0.4570457994644658) * (y * q5);
    out[12] = k(0.3731763325901154) * (z * (k(5.0) * zz - k(3.0)));
    out[13] = k(0.4570457994644658) * (x * q5);
    out[14] = k(1.445305721320277) * (z * d);
    out[15] = k(0.5900435899266435) * c3;
    out[16] = k(2.5033429417967046) * (xy * d);
    out[17] = k(1.7701307697799304) * (z * s3);
    out[18] = k(0.9461746957575601) * (xy * q7);
    out[19] = k(0.6690465435572892) * (yz * r7);
    out[20] = k(0.10578554691520431) * ((k(35.0) * zz - k(30.0)) * zz + k(3.0));
    out[21] = k(0.6690465435572892) * (xz * r7);
    out[22] = k(0.47308734787878004) * (d * q7);
    out[23] = k(1.7701307697799304) * (z * c3);
    out[24] = k(0.6258357354491761) * (xx * (xx - k(3.0) * yy) - yy * (k(3.0) * xx - yy));
}

// Coefficients of f(R s) -> f(s) for R a rotation about z by the angle whose cosine and sine are given: each pair
// (-m, m) turns by m times the angle.
template<class T, class Constant>
inline void sh_rotate_z(const Constant& k, const T cosine, const T sine, T c[25]) {
    T cm[5], sm[5];
    cm[1] = cosine;
    sm[1] = sine;
    for (int m = 2; m <= 4; ++m) {
        cm[m] = cm[m - 1] * cosine - sm[m - 1] * sine;
        sm[m] = sm[m - 1] * cosine + cm[m - 1] * sine;
    }
    static_cast<void>(k);
    for (int l = 1; l <= 4; ++l) {
        for (int m = 1; m <= l; ++m) {
            T& even = c[l * (l + 1) + m];
            T& odd = c[l * (l + 1) - m];
            const T turned = even * cm[m] - odd * sm[m];
            odd = odd * cm[m] + even * sm[m];
            even = turned;
        }
    }
}

// Coefficients of f(x, z, y): y and z exchanged. Its own inverse. Every entry is the square root of a multiple of
// 1/64; from the integrals of Y_i(x, z, y) Y_j(x, y, z).
template<class T, class Constant>
inline void sh_swap_yz(const Constant& k, const T c[25], T out[25]) {
    const T h = k(0.5), q = k(0.25), e = k(0.125), t = k(0.75), u = k(0.375);
    const T r48 = k(0.8660254037844386), r40 = k(0.7905694150420949), r24 = k(0.6123724356957945);
    const T r60 = k(0.9682458365518543), r56 = k(0.9354143466934853), r8 = k(0.35355339059327373);
    const T r28 = k(0.6614378277661477), r20 = k(0.5590169943749475), r35 = k(0.739509972887452);
    const T zero = k(0.0);
    out[0] = c[0];
    out[1] = c[2];
    out[2] = c[1];
    out[3] = c[3];
    out[4] = c[7];
    out[5] = c[5];
    out[6] = zero - h * c[6] - r48 * c[8];
    out[7] = c[4];
    out[8] = h * c[8] - r48 * c[6];
    out[9] = r24 * c[14] - r40 * c[12];
    out[10] = c[10];
    out[11] = zero - r24 * c[12] - r40 * c[14];
    out[12] = zero - r40 * c[9] - r24 * c[11];
    out[13] = zero - q * c[13] - r60 * c[15];
    out[14] = r24 * c[9] - r40 * c[11];
    out[15] = q * c[15] - r60 * c[13];
    out[16] = r8 * c[23] - r56 * c[21];
    out[17] = t * c[17] - r28 * c[19];
    out[18] = zero - r8 * c[21] - r56 * c[23];
    out[19] = zero - r28 * c[17] - t * c[19];
    out[20] = (u * c[20] + r20 * c[22]) + r35 * c[24];
    out[21] = zero - r56 * c[16] - r8 * c[18];
    out[22] = (r20 * c[20] + h * c[22]) - r28 * c[24];
    out[23] = r8 * c[16] - r56 * c[18];
    out[24] = (r35 * c[20] - r28 * c[22]) + e * c[24];
}

// Turns coefficients by Rz(azimuth) Ry(polar), given as cosines and sines. Ry(a) = swap Rz(-a) swap.
template<class T, class Constant>
inline void sh_rotate_zy(const Constant& k, const T cos_polar, const T sin_polar, const T cos_azimuth,
                         const T sin_azimuth, const T in[25], T out[25]) {
    T swapped[25];
    sh_swap_yz(k, in, swapped);
    sh_rotate_z(k, cos_polar, k(0.0) - sin_polar, swapped);
    sh_swap_yz(k, swapped, out);
    sh_rotate_z(k, cos_azimuth, sin_azimuth, out);
}
