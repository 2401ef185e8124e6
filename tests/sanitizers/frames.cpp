// Whole frames without a test framework, so that every sanitizer and valgrind can watch the library alone:
// each instruction set, each quality, one thread and three. `frames KIND` has a bug of a host's planted in,
// which the tool that is watching must report: a job that finds nothing would prove nothing.
#include "nusselt/nusselt.h"
#include "tests/jobs/executors.h"

#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace {

using namespace nusselt;

void check(const Status& status, const char* what) {
    if (status.ok()) return;
    std::printf("frames: %s: %s\n", what, status.text);
    std::exit(1);
}

// A torus. Arrays of its own, exactly as long as they say.
struct Torus {
    static constexpr uint32_t around = 16, across = 8, count = around * across;
    std::unique_ptr<float[]> positions{new float[3 * count]}, normals{new float[3 * count]};
    std::vector<uint32_t> indices;

    explicit Torus(float height) {
        for (uint32_t i = 0; i < around; ++i) {
            for (uint32_t j = 0; j < across; ++j) {
                const float a = 6.2831853f * float(i) / around, b = 6.2831853f * float(j) / across;
                float* const p = positions.get() + 3 * (i * across + j);
                float* const n = normals.get() + 3 * (i * across + j);
                n[0] = std::cos(a) * std::cos(b), n[1] = std::sin(a) * std::cos(b), n[2] = std::sin(b);
                p[0] = std::cos(a) + 0.4f * n[0], p[1] = std::sin(a) + 0.4f * n[1];
                p[2] = height + 0.4f * n[2];
                const uint32_t c = i * across, d = (i + 1) % around * across, k = (j + 1) % across;
                for (const uint32_t index : {c + j, d + j, d + k, c + j, d + k, c + k})
                    indices.push_back(index);
            }
        }
    }
};

// Branches on every bit that the library wrote: one that it did not write shows in the tools.
uint32_t look_at(const std::vector<float>& transfer, const uint32_t* masks, size_t words) {
    uint32_t odd = 0;
    for (const float t : transfer)
        if (!(std::fabs(t) < 10)) ++odd;
    for (size_t i = 0; i < words; ++i)
        if (masks[i] == 0xDEADBEEF) ++odd;
    return odd;
}

struct Frames {
    Context* context = nullptr;
    std::vector<Torus> tori;
    std::vector<MeshId> ids;
    std::vector<std::vector<float>> transfer;
    std::vector<std::unique_ptr<uint32_t[]>> masks;

    Frames(const ContextDesc& desc, uint32_t meshes) {
        check(create_context(desc, &context), "create_context");
        for (uint32_t m = 0; m < meshes; ++m) {
            tori.emplace_back(float(m));
            const Torus& t = tori.back();
            ids.emplace_back();
            check(add_mesh(context,
                           {{t.positions.get(), Torus::count, 12},
                            {t.normals.get(), Torus::count, 12},
                            t.indices.data(),
                            t.indices.size()},
                           &ids.back()),
                  "add_mesh");
        }
    }
    ~Frames() { check(destroy_context(context), "destroy_context"); }

    FrameId submit(Quality quality) {
        const size_t words = quality_mask_bits(quality) / 32;
        std::vector<FrameMesh> frame;
        transfer.clear();
        masks.clear();
        for (size_t m = 0; m < tori.size(); ++m) {
            transfer.emplace_back(25 * Torus::count);
            masks.emplace_back(new uint32_t[words * Torus::count]);
            frame.push_back({ids[m],
                             {tori[m].positions.get(), Torus::count, 12},
                             {tori[m].normals.get(), Torus::count, 12},
                             {transfer.back().data(), Torus::count, 100},
                             {masks.back().get(), Torus::count, 4 * words}});
        }
        FrameId id;
        check(nusselt::submit(context, {frame.data(), uint32_t(frame.size()), quality}, &id), "submit");
        return id;
    }
    void finish(FrameId id, Quality quality) {
        FrameStats stats;
        const Status status = wait(context, id, &stats);
        if (status.code != StatusCode::changed) check(status, "wait");
        for (size_t m = 0; m < tori.size(); ++m) {
            const uint32_t odd =
                look_at(transfer[m], masks[m].get(), quality_mask_bits(quality) / 32 * Torus::count);
            if (odd > 0) std::printf("frames: %u odd values\n", odd);
        }
    }
};

// Every instruction set, quality and executor, with a few vertices that are not finite.
void all_frames(bool every_quality) {
    for (const Isa isa : {Isa::scalar, Isa::sse4, Isa::avx2, Isa::avx512, Isa::neon}) {
        if (!isa_available(isa)) continue;
        for (const uint32_t threads : {0u, 2u}) {
            test::TestExecutor executor({"pool", test::Order::fifo, threads, 2});
            ContextDesc desc;
            desc.isa = isa;
            if (threads > 0) desc.executor = executor.hook();
            Frames frames(desc, 2);
            frames.tori[1].positions[7] = std::numeric_limits<float>::quiet_NaN();
            frames.tori[1].normals[25] = std::numeric_limits<float>::infinity();
            for (const Quality quality : {Quality::standard, Quality::draft, Quality::paper, Quality::fine}) {
                if (!every_quality && quality != Quality::standard) continue;
                for (int i = 0; i < 2; ++i)
                    frames.finish(frames.submit(quality), quality);
            }
            // One mesh goes and comes back.
            check(remove_mesh(frames.context, frames.ids[0]), "remove_mesh");
            const Torus& t = frames.tori[0];
            check(add_mesh(frames.context,
                           {{t.positions.get(), Torus::count, 12}, {}, t.indices.data(), t.indices.size()},
                           &frames.ids[0]),
                  "add_mesh");
            const FrameId id = frames.submit(Quality::standard);
            check(cancel(frames.context, id), "cancel");
            check(wait(frames.context, id, nullptr), "wait");
        }
        std::printf("frames: %s\n", isa_name(isa));
    }
}

// An array that ends a vertex early.
void plant_overflow() {
    Frames frames({}, 1);
    std::unique_ptr<float[]> less(new float[3 * (Torus::count - 1)]);
    std::memcpy(less.get(), frames.tori[0].positions.get(), 12 * (Torus::count - 1));
    frames.tori[0].positions = std::move(less);
    frames.finish(frames.submit(Quality::standard), Quality::standard);
}

// A frame's results freed while it works.
void plant_freed() {
    test::TestExecutor executor({"late", test::Order::fifo, 0, 1}); // tasks start in wait
    ContextDesc desc;
    desc.executor = executor.hook();
    Frames frames(desc, 1);
    const FrameId id = frames.submit(Quality::standard);
    frames.masks[0].reset();
    check(wait(frames.context, id, nullptr), "wait");
}

// Floats that begin at an odd address.
void plant_misaligned() {
    Frames frames({}, 1);
    std::vector<char> bytes(12 * Torus::count + 1);
    std::memcpy(bytes.data() + 1, frames.tori[0].positions.get(), 12 * Torus::count);
    const FrameMesh mesh{frames.ids[0],
                         {reinterpret_cast<const float*>(bytes.data() + 1), Torus::count, 12},
                         {frames.tori[0].normals.get(), Torus::count, 12},
                         {},
                         {}};
    FrameId id;
    check(submit(frames.context, {&mesh, 1, Quality::standard}, &id), "submit");
    check(wait(frames.context, id, nullptr), "wait");
}

// A host that writes positions while a frame reads them.
void plant_race() {
    test::TestExecutor executor({"pool", test::Order::fifo, 2, 2});
    ContextDesc desc;
    desc.executor = executor.hook();
    Frames frames(desc, 2);
    for (int i = 0; i < 20; ++i) {
        const FrameId id = frames.submit(Quality::standard);
        for (uint32_t v = 0; v < 3 * Torus::count; ++v)
            frames.tori[0].positions[v] *= 1.0001f;
        frames.finish(id, Quality::standard);
    }
}

// The same on oneTBB, and frames that have nothing wrong.
void on_tbb(bool race) {
    ContextDesc desc;
    check(create_tbb_executor(3, &desc.executor), "create_tbb_executor");
    {
        Frames frames(desc, 2);
        for (int i = 0; i < 20; ++i) {
            const FrameId id = frames.submit(Quality::standard);
            for (uint32_t v = 0; race && v < 3 * Torus::count; ++v)
                frames.tori[0].positions[v] *= 1.0001f;
            frames.finish(id, Quality::standard);
        }
    }
    destroy_executor(&desc.executor);
}

// A vertex that nobody has written.
void plant_uninitialised() {
    Frames frames({}, 1);
    std::unique_ptr<float[]> fresh(new float[3 * Torus::count]);
    std::memcpy(fresh.get(), frames.tori[0].positions.get(), 12 * (Torus::count - 1));
    frames.tori[0].positions = std::move(fresh);
    frames.finish(frames.submit(Quality::standard), Quality::standard);
}

// A context that is forgotten.
void plant_leak() {
    Context* context = nullptr;
    check(create_context({}, &context), "create_context");
    context = nullptr;
}

} // namespace

int main(int argc, char** argv) {
    const std::string kind = argc > 1 ? argv[1] : "all";
    if (kind == "all" || kind == "standard") {
        all_frames(kind == "all");
    } else if (kind == "overflow") {
        plant_overflow();
    } else if (kind == "freed") {
        plant_freed();
    } else if (kind == "misaligned") {
        plant_misaligned();
    } else if (kind == "race") {
        plant_race();
    } else if (kind == "tbb" || kind == "race_tbb") {
        on_tbb(kind == "race_tbb");
    } else if (kind == "uninitialised") {
        plant_uninitialised();
    } else if (kind == "leak") {
        plant_leak();
    } else {
        std::printf("frames: there is no '%s'\n", kind.c_str());
        return 2;
    }
    std::printf("frames: done\n");
    return 0;
}
