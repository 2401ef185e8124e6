// Streams that a frame writes beside, or instead of, transfer vectors: smaller, and as a renderer reads them.
// Each element is written once, whole, in no order, and never read: memory may be mapped from a GPU and
// write-combined.
#pragma once

#include <cstddef>
#include <cstdint>

namespace nusselt {

enum class OutputKind : uint32_t {
    // The transfer vector's first `bands` bands, each times its factor of `window`: bands * bands terms.
    transfer = 0,
    // One component: the part of the hemisphere that sees the environment, weighted by the cosine. 1 is open,
    // 0 dark; so radiance under a white sky of radiance 1.
    ambient_occlusion = 1,
    // Three components: the unit mean direction of what is seen, weighted by the cosine; the normal where
    // nothing is seen. For one look-up into irradiance, to be multiplied by the ambient occlusion.
    bent_normal = 2,
    // Transfer with the mesh's FrameMesh::gloss for one view: three transfer vectors one after the other, for
    // red, green and blue, albedos included. A grey material's are equal. packed8 packs each.
    glossy = 3,
    // Radiance towards the viewer under FrameDesc::light, three components. With FrameMesh::gloss its
    // materials', without it a white Lambert surface's (multiply by your albedo). Not in packed8.
    radiance = 4,
    // The same under FrameDesc::environment, integrated directly from the masks: light of all frequencies.
    direct = 5,
};

enum class OutputFormat : uint32_t {
    float32 = 0, // as computed
    float16 = 1, // IEEE half floats, rounded to nearest: adds 0.02 % error to a transfer vector in the mean
    // Ambient occlusion as one unorm byte, bent normals as three snorm bytes (within 0.4 degrees), transfer
    // vectors as `unpack_transfer` reads them, 32 bytes for 5 bands: bands 0 and 1 as half floats, then a
    // scale byte for each further band, then a snorm byte a term. Adds 0.1 to 0.2 % error to a transfer
    // vector in the mean (docs/outputs.md has the figures).
    packed8 = 2,
};

// One stream of a mesh in a frame. What is left 0 has its default.
struct Output {
    OutputKind kind = OutputKind::transfer;
    OutputFormat format = OutputFormat::float32;
    void* data = nullptr; // of vertex 0; aligned to 4, 2 or 1 bytes by format (packed8: any address)
    size_t count = 0;     // the mesh's V
    size_t stride = 0;    // bytes from one vertex to the next; a multiple of the alignment; 0: output_bytes
    uint32_t bands = 0;   // of a transfer vector, 1 to 5; 0: 5; radiance always uses all 5
    // Factors of a transfer vector's bands, each 0 to 1 and the first 1; all 0: no window. Radiance is a dot
    // product, so a window on the light does the same: use one of the two.
    float window[5] = {};
};

// Bytes of one element; 0 for a description that cannot be meant.
size_t output_bytes(OutputKind kind, OutputFormat format, uint32_t bands = 5);

// The 25 terms that an element of OutputFormat::packed8 with so many bands stands for (those of further bands
// 0): V_lm = byte / 127 * scale_l / 255 * sqrt(2 l + 1) * V_00, and in band 2 also what band 1 lets expect:
// with (y, z, x) = V_1m and s = 0.81941133 / V_00 (0 where V_00 <= 0)
//   s x y, s y z, 0.28867513 s (2 z^2 - x^2 - y^2), s x z, s (x^2 - y^2) / 2.
// `bands` 1 to 5.
void unpack_transfer(const void* packed, uint32_t bands, float out[25]);

// Windows damp the high bands, and with them the ringing of a hard light cut off at band 4.
enum class ShWindow : uint32_t {
    hann = 0,    // (1 + cos(pi l / width)) / 2
    lanczos = 1, // sin(pi l / width) / (pi l / width)
};

// Factors of the five bands; bands from `width` on get 0. `width` in bands, above 0: 5 is strong, 10 mild. A
// width that is not above 0 gives the first band alone. For Output::window, or for light by sh_apply_window.
void sh_window(ShWindow window, float width, float out[5]);

// coefficients[term] *= window[band of term], for each of `channels` interleaved channels: 3 for light as
// sh_project_latlong writes it, 1 for a transfer vector.
void sh_apply_window(const float window[5], uint32_t channels, float* coefficients);

} // namespace nusselt
