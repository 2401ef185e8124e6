// Encoded streams against what their formats say, and every instruction set against the reference.
#include "kernels/half.h"
#include "kernels/outputs.h"
#include "tests/kernels/fixture.h"

#include <cmath>
#include <cstring>

namespace nusselt::test {

using namespace kernels;

namespace {

// What the bits mean, by the definition of the format.
double half_value(uint32_t half) {
    const double sign = half & 0x8000 ? -1 : 1;
    const int exponent = int(half >> 10 & 31);
    const uint32_t mantissa = half & 1023;
    return sign * (exponent ? std::ldexp(1024 + mantissa, exponent - 25) : std::ldexp(mantissa, -24));
}

TEST(Half, EveryFiniteOneAndTheMiddlesBetween) {
    for (uint32_t half = 0; half < 0x7C00; ++half) {
        const double value = half_value(half);
        ASSERT_EQ(double(float_from_half(uint16_t(half))), value);
        ASSERT_EQ(double(float_from_half(uint16_t(half | 0x8000))), -value);
        ASSERT_EQ(half_from_float(float(value)), half);
        ASSERT_EQ(half_from_float(-float(value)), half | 0x8000);
        if (half + 1 == 0x7C00) break;
        const float middle = float((value + half_value(half + 1)) / 2); // exact: 12 bits
        ASSERT_EQ(half_from_float(middle), half + (half & 1)) << half;
        ASSERT_EQ(half_from_float(std::nextafter(middle, 0.0f)), half);
        ASSERT_EQ(half_from_float(std::nextafter(middle, 1e9f)), half + 1);
    }
    EXPECT_EQ(half_from_float(65504.0f), 0x7BFF);
    EXPECT_EQ(half_from_float(65519.99f), 0x7BFF);
    EXPECT_EQ(half_from_float(65520.0f), 0x7C00);
    EXPECT_EQ(half_from_float(-1e30f), 0xFC00);
    EXPECT_EQ(half_from_float(1e-30f), 0);
}

struct EncodeInput {
    BatchInput input;
    alignas(64) float transfer[25][lanes];
};

// Transfer vectors as random masks give them: positive combinations of directions.
EncodeInput random_input(Random& random) {
    EncodeInput e;
    random_batch(random, random.one_in(3), 1.0f, e.input);
    kernels_for(Set::scalar)->prepare_batch(e.input.batch, e.input.normal);
    for (uint32_t lane = 0; lane < lanes; ++lane) {
        const uint32_t count = random.below(6); // 0: dark
        const float scale = random.one_in(4) ? 1e-4f : 0.2f;
        float sum[25] = {};
        for (uint32_t k = 0; k < count; ++k) {
            float d[3], basis[25];
            random.direction(d);
            kernels_for(Set::scalar)->evaluate_sh(d, d + 1, d + 2, 1, basis);
            const float weight = scale * random.between(0, 1);
            for (uint32_t i = 0; i < 25; ++i)
                sum[i] += weight * basis[i];
        }
        for (uint32_t i = 0; i < 25; ++i)
            e.transfer[i][lane] = e.input.batch.valid >> lane & 1 ? sum[i] : 0.0f;
    }
    return e;
}

std::vector<Encoding> all_encodings() {
    std::vector<Encoding> all = {{Quantity::radiance, Format::float32, 5, {1, 1, 1, 1, 1}},
                                 {Quantity::radiance, Format::float16, 5, {1, 1, 1, 1, 1}},
                                 {Quantity::glossy, Format::packed8, 5, {1, 1, 1, 1, 1}}};
    for (const Format format : {Format::float32, Format::float16, Format::packed8}) {
        all.push_back({Quantity::ambient_occlusion, format, 5, {1, 1, 1, 1, 1}});
        all.push_back({Quantity::bent_normal, format, 5, {1, 1, 1, 1, 1}});
        for (uint32_t bands = 1; bands <= 5; ++bands) {
            all.push_back({Quantity::transfer, format, bands, {1, 1, 1, 1, 1}});
            all.push_back({Quantity::transfer, format, bands, {1, 0.9f, 0.5f, 0.1f, 0}});
        }
    }
    return all;
}

constexpr size_t most_bytes = size_t(lanes) * most_encoded_bytes;

std::vector<uint8_t> encoded(const OutputKernels& k, const Encoding& e, const EncodeInput& in) {
    std::vector<uint8_t> out(most_bytes + 1, 0xA5);
    k.encode(e, in.input.batch, in.transfer, out.data(), encoded_bytes(e));
    return out;
}

TEST(Encode, SizesAndNothingBeyond) {
    Random random(1);
    const EncodeInput in = random_input(random);
    for (const Encoding& e : all_encodings()) {
        const std::vector<uint8_t> out = encoded(*output_kernels_for(Set::scalar), e, in);
        ASSERT_LE(encoded_bytes(e), most_encoded_bytes);
        for (size_t i = size_t(lanes) * encoded_bytes(e); i < out.size(); ++i)
            ASSERT_EQ(out[i], 0xA5);
    }
    const auto bytes = [](uint32_t bands) {
        return encoded_bytes({Quantity::transfer, Format::packed8, bands, {1, 1, 1, 1, 1}});
    };
    EXPECT_EQ(bytes(1), 2u);
    EXPECT_EQ(bytes(2), 8u);
    EXPECT_EQ(bytes(3), 14u);
    EXPECT_EQ(bytes(4), 22u);
    EXPECT_EQ(bytes(5), 32u);
}

TEST(Encode, FloatsAreTheTermsTimesTheWindow) {
    for (uint64_t seed = 0; seed < 50; ++seed) {
        Random random(seed);
        const EncodeInput in = random_input(random);
        for (const Encoding& e : all_encodings()) {
            if (e.quantity != Quantity::transfer || e.format == Format::packed8) continue;
            const std::vector<uint8_t> out = encoded(*output_kernels_for(Set::scalar), e, in);
            for (uint32_t lane = 0; lane < lanes; ++lane) {
                for (uint32_t i = 0; i < e.bands * e.bands; ++i) {
                    const uint32_t band = uint32_t(std::sqrt(double(i)));
                    const float wanted = in.transfer[i][lane] * e.window[band];
                    const uint8_t* at = out.data() + lane * encoded_bytes(e);
                    float value;
                    uint16_t half;
                    std::memcpy(&value, at + 4 * i, 4);
                    std::memcpy(&half, at + 2 * i, 2);
                    if (e.format == Format::float32) {
                        ASSERT_EQ(value, wanted);
                    } else {
                        ASSERT_EQ(half, half_from_float(wanted));
                    }
                }
            }
        }
    }
}

TEST(Encode, AmbientOcclusionAndBentNormal) {
    EncodeInput in{};
    in.input.batch.valid = 0xF;
    float basis[25];
    const float d[3] = {0.48f, -0.6f, 0.64f};
    kernels_for(Set::scalar)->evaluate_sh(d, d + 1, d + 2, 1, basis);
    for (uint32_t i = 0; i < 25; ++i) {
        in.transfer[i][0] = 0.25f * basis[i]; // a quarter, from direction d
        in.transfer[i][1] = basis[i] * 1.001f;
    }
    for (uint32_t lane = 0; lane < 4; ++lane)
        in.input.batch.axis[2][1][lane] = 1; // normals along y
    const auto get = [&](Quantity q, Format f) {
        return encoded(*output_kernels_for(Set::scalar), {q, f, 5, {1, 1, 1, 1, 1}}, in);
    };
    const std::vector<uint8_t> ao = get(Quantity::ambient_occlusion, Format::float32);
    const float* seen = reinterpret_cast<const float*>(ao.data());
    EXPECT_NEAR(seen[0], 0.25f, 1e-6f);
    EXPECT_EQ(seen[1], 1.0f); // never above
    EXPECT_EQ(seen[2], 0.0f);
    const std::vector<uint8_t> ao8 = get(Quantity::ambient_occlusion, Format::packed8);
    EXPECT_EQ(ao8[0], 64);
    EXPECT_EQ(ao8[1], 255);
    EXPECT_EQ(ao8[2], 0);
    const std::vector<uint8_t> bent = get(Quantity::bent_normal, Format::float32);
    const float* axis = reinterpret_cast<const float*>(bent.data());
    for (uint32_t k = 0; k < 3; ++k) {
        EXPECT_NEAR(axis[k], d[k], 1e-6f);
        EXPECT_EQ(axis[6 + k], k == 1 ? 1.0f : 0.0f); // dark: the normal
        EXPECT_EQ(axis[12 + k], 0.0f);                // not valid
    }
    const std::vector<uint8_t> bent8 = get(Quantity::bent_normal, Format::packed8);
    EXPECT_EQ(int8_t(bent8[0]), 61);
    EXPECT_EQ(int8_t(bent8[1]), -76);
    EXPECT_EQ(int8_t(bent8[2]), 81);
}

// The instruction set NUSSELT_TEST_SET.
class OutputSets : public testing::Test {
protected:
    void SetUp() override {
        const std::optional<Set> set = set_to_test();
        if (!set) GTEST_SKIP() << "SKIPPED: NUSSELT_TEST_SET names no set that runs here";
        k = output_kernels_for(*set);
        ASSERT_NE(k, nullptr);
    }
    const OutputKernels* k = nullptr;
};

TEST_F(OutputSets, Encode) {
    for (uint64_t seed = 0; seed < 1000; ++seed) {
        Random random(seed);
        const EncodeInput in = random_input(random);
        for (const Encoding& e : all_encodings()) {
            ASSERT_EQ(encoded(*k, e, in), encoded(*output_kernels_for(Set::scalar), e, in))
                << "seed " << seed << " quantity " << uint32_t(e.quantity) << " format " << uint32_t(e.format)
                << " bands " << e.bands;
        }
    }
}

} // namespace

} // namespace nusselt::test
