// Glossy transfer and radiance: every instruction set against the reference.
#include "kernels/light.h"
#include "tests/kernels/fixture.h"

#include <cmath>

namespace nusselt::test {

using namespace kernels;

namespace {

struct GlossyTables {
    AlignedArray<float> memory;
    CellTables cells;

    explicit GlossyTables(const MaskLayout& layout)
        : memory(aligned_array<float>(cell_table_size(layout))),
          cells(build_cell_tables(layout, tables_of(layout).scale,
                                  std::vector<SampleBit>(mask_bits(layout)).data(), memory.get())) {}
};

Reflection random_reflection(Random& random, const CellTables& cells) {
    Reflection r{};
    r.lobe = random.one_in(8) ? Lobe::none : random.one_in(2) ? Lobe::phong : Lobe::ggx;
    r.exponent = random.one_in(4) ? 0 : random.below(600);
    r.alpha = random.one_in(3) ? cells.sharpest : random.between(cells.sharpest, 1);
    r.core = random.one_in(4) ? 1.0f : random.between(0.7f, 0.95f);
    for (uint32_t c = 0; c < 3; ++c) {
        r.diffuse[c] = random.between(0, 1);
        r.specular[c] = random.between(0, 1);
    }
    random.direction(r.view);
    r.view[2] = std::max(std::fabs(r.view[2]), 0.01f);
    return r;
}

// As frames have them: blobs, mostly whole blocks.
void random_masks(Random& random, const MaskLayout& layout, uint8_t* masks) {
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        uint8_t* mask = masks + size_t(lane) * mask_bytes(layout);
        float axis[3];
        random.direction(axis);
        const float reach = random.between(-0.5f, 1);
        for (uint32_t bit = 0; bit < mask_bits(layout); ++bit) {
            double d[3] = {0, 0, 0};
            if (!sample_direction(layout, bit, d)) continue;
            const bool blocked = axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2] > reach;
            mask[bit / 8] = uint8_t(mask[bit / 8] | uint32_t(blocked) << (bit % 8));
        }
    }
}

// No BRDF but the diffuse part: the kernel hands on what integrate made.
TEST(Glossy, WithoutALobeItIsDiffuse) {
    const MaskLayout layout = standard_layout;
    const GlossyTables tables(layout);
    auto masks = aligned_array<uint8_t>(size_t(lanes) * mask_bytes(layout));
    Random random(3);
    random_masks(random, layout, masks.get());
    alignas(64) float diffuse[25][lanes], local[3][25][lanes];
    Counters counters{};
    kernels_for(Set::scalar)->integrate(tables_of(layout), masks.get(), 0x7FFF, false, 5, diffuse, counters);
    Reflection reflections[lanes] = {};
    for (Reflection& r : reflections) {
        r = random_reflection(random, tables.cells);
        r.lobe = Lobe::phong;
        for (uint32_t c = 0; c < 3; ++c)
            r.specular[c] = 0;
    }
    light_kernels_for(Set::scalar)
        ->integrate_glossy(tables_of(layout), tables.cells, masks.get(), 0x7FFF, reflections, 3, diffuse,
                           local);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        for (uint32_t c = 0; c < 3; ++c) {
            for (uint32_t i = 0; i < 25; ++i)
                ASSERT_EQ(local[c][i][lane],
                          lane < 15 ? reflections[lane].diffuse[c] * diffuse[i][lane] : 0.0f);
        }
    }
}

// The instruction set NUSSELT_TEST_SET.
class LightSets : public testing::Test {
protected:
    void SetUp() override {
        const std::optional<Set> set = set_to_test();
        if (!set) GTEST_SKIP() << "SKIPPED: NUSSELT_TEST_SET names no set that runs here";
        k = light_kernels_for(*set);
        ASSERT_NE(k, nullptr);
    }
    const LightKernels* k = nullptr;
};

TEST_F(LightSets, GlossyAndShade) {
    for (const NamedLayout& l : layouts) {
        const GlossyTables tables(l.layout);
        for (uint64_t seed = 0; seed < 60; ++seed) {
            Random random(seed);
            auto masks = aligned_array<uint8_t>(size_t(lanes) * mask_bytes(l.layout));
            random_masks(random, l.layout, masks.get());
            Reflection reflections[lanes];
            for (Reflection& r : reflections)
                r = random_reflection(random, tables.cells);
            const uint32_t valid = random.below(0x10000), channels = random.one_in(2) ? 1 : 3;
            alignas(64) float diffuse[25][lanes], ours[3][25][lanes] = {}, theirs[3][25][lanes] = {};
            Counters counters{};
            kernels_for(Set::scalar)
                ->integrate(tables_of(l.layout), masks.get(), valid, false, 5, diffuse, counters);
            k->integrate_glossy(tables_of(l.layout), tables.cells, masks.get(), valid, reflections, channels,
                                diffuse, ours);
            light_kernels_for(Set::scalar)
                ->integrate_glossy(tables_of(l.layout), tables.cells, masks.get(), valid, reflections,
                                   channels, diffuse, theirs);
            ASSERT_TRUE(same_bits(ours, theirs, sizeof(ours))) << l.name << " seed " << seed;
            float light[75];
            for (float& c : light)
                c = random.between(-1, 2);
            alignas(64) float rgb[2][3][lanes];
            k->shade_batch(light, ours, rgb[0]);
            light_kernels_for(Set::scalar)->shade_batch(light, ours, rgb[1]);
            ASSERT_TRUE(same_bits(rgb[0], rgb[1], sizeof(rgb[0])));
        }
    }
}

TEST_F(LightSets, ProductsOfTheBasis) {
    constexpr uint32_t blocks = 64;
    for (uint64_t seed = 0; seed < 20; ++seed) {
        Random random(seed);
        auto products = aligned_array<float>(size_t(blocks) * product_stride);
        for (uint32_t i = 0; i < blocks * product_stride; ++i)
            products[i] = random.between(-1, 1);
        uint8_t counts[blocks];
        for (uint8_t& count : counts)
            count = uint8_t(random.one_in(2) ? 0 : random.below(17));
        alignas(64) float hidden[2][product_stride];
        for (uint32_t i = 0; i < product_stride; ++i)
            hidden[0][i] = hidden[1][i] = random.between(-1, 1);
        k->add_hidden(products.get(), counts, blocks, hidden[0]);
        light_kernels_for(Set::scalar)->add_hidden(products.get(), counts, blocks, hidden[1]);
        ASSERT_TRUE(same_bits(hidden[0], hidden[1], sizeof(hidden[0]))) << seed;

        float matrix[25][25];
        alignas(64) float transfer[25][lanes], out[2][25][lanes];
        for (auto& row : matrix)
            for (float& m : row)
                m = random.between(-1, 1);
        for (auto& row : transfer)
            for (float& t : row)
                t = random.between(-1, 1);
        k->multiply_transfer(matrix, transfer, out[0]);
        light_kernels_for(Set::scalar)->multiply_transfer(matrix, transfer, out[1]);
        ASSERT_TRUE(same_bits(out[0], out[1], sizeof(out[0]))) << seed;
        // In double.
        double sum = 0;
        for (uint32_t j = 0; j < 25; ++j)
            sum += double(matrix[7][j]) * transfer[j][3];
        ASSERT_NEAR(out[0][7][3], sum, 1e-5);
    }
}

TEST_F(LightSets, IntegrateSky) {
    for (const NamedLayout& l : layouts) {
        const GlossyTables tables(l.layout);
        for (uint64_t seed = 0; seed < 40; ++seed) {
            Random random(seed);
            SkyMap sky{};
            uint32_t texels = 0;
            for (uint32_t level = 0; level < sky_levels; ++level) {
                sky.size[level] = 1 + random.below(40);
                sky.begin[level] = texels;
                texels += sky.size[level] * sky.size[level];
            }
            auto memory = aligned_array<float>(size_t(texels) * 4);
            for (uint32_t i = 0; i < texels * 4; ++i)
                memory[i] = i % 4 == 3 ? 0.0f : random.between(0, 10);
            sky.texels = memory.get();
            BatchInput input;
            random_batch(random, random.one_in(3), 2.0f, input);
            kernels_for(Set::scalar)->prepare_batch(input.batch, input.normal);
            auto masks = aligned_array<uint8_t>(size_t(lanes) * mask_bytes(l.layout));
            random_masks(random, l.layout, masks.get());
            Reflection reflections[lanes];
            for (Reflection& r : reflections)
                r = random_reflection(random, tables.cells);
            for (const Reflection* r :
                 {static_cast<const Reflection*>(nullptr), static_cast<const Reflection*>(reflections)}) {
                alignas(64) float ours[3][lanes], theirs[3][lanes];
                k->integrate_sky(tables_of(l.layout), tables.cells, sky, input.batch, masks.get(), r, ours);
                light_kernels_for(Set::scalar)
                    ->integrate_sky(tables_of(l.layout), tables.cells, sky, input.batch, masks.get(), r,
                                    theirs);
                ASSERT_TRUE(same_bits(ours, theirs, sizeof(ours))) << l.name << " seed " << seed;
            }
        }
    }
}

} // namespace

} // namespace nusselt::test
