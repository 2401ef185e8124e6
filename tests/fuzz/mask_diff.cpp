#include "tests/fuzz/fuzz.h"
#include "tests/stress/raster.h"

#include <cmath>

namespace nusselt::fuzz {

namespace {

using namespace kernels;

// A frame's points are at most 1 in size, or not finite.
float frame_float(Bytes& in, uint8_t kind) {
    float value = kind & 1 ? in.raw_float() : in.small_float() / 2;
    int exponent = 0;
    if (std::isfinite(value) && std::fabs(value) > 1) value = std::frexp(value, &exponent);
    return value;
}

} // namespace

// Up to 64 raw triangles and sixteen receivers: every instruction set gives the same bits; the mask of loose
// triangles is the union of what two halves of them have.
int mask_diff(const uint8_t* data, size_t size) {
    Bytes in{data, size};
    const uint8_t kind = in.byte();
    const MaskLayout layout = (kind & 6) == 6 ? draft_layout
                              : kind & 2      ? fine_layout
                              : kind & 4      ? paper_layout
                                              : standard_layout;
    Batch batch{};
    alignas(64) float normal[3][lanes];
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        for (uint32_t k = 0; k < 3; ++k) {
            // Few receivers of their own: triangles are what matters.
            const bool own = lane < 1u + (kind >> 5);
            batch.position[k][lane] =
                own ? frame_float(in, kind >> 3 & 1) : batch.position[k][lane - 1] * 0.5f;
            normal[k][lane] = own ? (kind & 16 ? in.raw_float() : in.small_float()) : normal[2 - k][lane - 1];
        }
    }
    test::Soup soup;
    soup.two_sided = in.byte() & 1;
    for (uint32_t t = 0; t < 64 && !in.empty(); ++t) {
        const uint8_t shape = in.byte();
        std::array<uint32_t, 3> triangle{};
        for (uint32_t k = 0; k < 3; ++k) {
            const auto points = uint32_t(soup.points.size());
            if (shape >> k & 1 && points > 0) {
                triangle[k] = in.below(points);
            } else {
                triangle[k] = points;
                soup.points.push_back(
                    {frame_float(in, shape >> 3), frame_float(in, shape >> 3), frame_float(in, shape >> 3)});
            }
        }
        if (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0]) continue;
        soup.triangles.push_back(triangle);
    }
    test::Masks first, first_free;
    Batch first_batch{};
    for (const Set set : {Set::scalar, Set::sse4, Set::avx2, Set::avx512, Set::neon}) {
        const Kernels* kernels = kernels_for(set);
        if (!kernels) continue;
        Batch own = batch;
        own.valid = 0xFFFF;
        kernels->prepare_batch(own, normal);
        test::Soup here = soup;
#if defined(NUSSELT_PLANT)
        // A reciprocal estimate on one instruction set: 12 bits of one number.
        for (size_t k = 0; set == Set::avx2 && k < here.points.size(); k += 3)
            here.points[k][0] *= 1 + 0x1p-12f;
#endif
        const test::Masks masks = rasterize(*kernels, layout, own, here),
                          free = rasterize_free(*kernels, layout, own, here);
        if (set == Set::scalar) {
            first = masks;
            first_free = free;
            first_batch = own;
        }
        expect(test::same_bits(&own.position, &first_batch.position, sizeof(own.position)) &&
                   test::same_bits(&own.axis, &first_batch.axis, sizeof(own.axis)) &&
                   own.valid == first_batch.valid,
               "every instruction set prepares the same batch");
        expect(masks == first, "every instruction set gives the same masks of clusters");
        expect(free == first_free, "every instruction set gives the same masks of free triangles");
    }
    test::Masks both[2];
    for (size_t half = 0; half < 2; ++half) {
        test::Soup some = soup;
        some.triangles.clear();
        for (size_t t = half; t < soup.triangles.size(); t += 2)
            some.triangles.push_back(soup.triangles[t]);
        both[half] = rasterize_free(test::widest(), layout, first_batch, some);
    }
    for (size_t k = 0; k < first_free.size(); ++k)
        expect(first_free[k] == (both[0][k] | both[1][k]),
               "the mask of loose triangles is their masks' union");
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        if (first_batch.valid >> lane & 1) continue;
        expect(test::count_bits(first.data() + lane * mask_bytes(layout), mask_bytes(layout)) == 0,
               "a receiver that is none has an empty mask");
    }
    return 0;
}

} // namespace nusselt::fuzz
