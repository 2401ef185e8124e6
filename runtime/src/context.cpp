#include "context_data.h"
#include "shared_tables.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>

namespace nusselt {

namespace {

constexpr const char* isa_names[] = {"scalar", "sse4", "avx2", "avx512", "neon"};

const kernels::Kernels* kernels_of(Isa isa) {
    return isa <= Isa::neon ? kernels::kernels_for(static_cast<kernels::Set>(isa)) : nullptr;
}

Isa best_isa() {
    for (const Isa isa : {Isa::neon, Isa::avx512, Isa::avx2, Isa::sse4}) {
        if (kernels_of(isa)) return isa;
    }
    return Isa::scalar;
}

} // namespace

const char* isa_name(Isa isa) {
    if (isa == Isa::best) return "best";
    return isa <= Isa::neon ? isa_names[static_cast<uint32_t>(isa)] : "unknown";
}

bool isa_from_name(const char* name, Isa* out) {
    if (!name || !out) return false;
    for (uint32_t i = 0; i < kernels::set_count; ++i) {
        if (std::strcmp(name, isa_names[i]) == 0) {
            *out = static_cast<Isa>(i);
            return true;
        }
    }
    if (std::strcmp(name, "best") != 0) return false;
    *out = Isa::best;
    return true;
}

bool isa_available(Isa isa) {
    return isa == Isa::best || kernels_of(isa) != nullptr;
}

Status create_context(const ContextDesc& desc, Context** out) {
    if (!out) return {StatusCode::invalid_argument, "no context made: out is null; pass where to write it"};
    *out = nullptr;
    if (!desc.allocator.allocate != !desc.allocator.release)
        return {StatusCode::invalid_argument,
                "no context made: the allocator has only one of its two functions; give both or none"};
    if (desc.executor.enqueue && !desc.executor.finish)
        return {StatusCode::invalid_argument, "no context made: the executor has enqueue but no finish; give "
                                              "both, or none for serial_executor()"};
    if (!desc.profiler.begin != !desc.profiler.end)
        return {StatusCode::invalid_argument,
                "no context made: the profiler has only one of its two functions; give both or none"};
    Isa isa = desc.isa;
    if (isa == Isa::best) {
        const char* forced = std::getenv("NUSSELT_ISA");
        if (forced && *forced && !isa_from_name(forced, &isa))
            return {StatusCode::unsupported,
                    "no context made: NUSSELT_ISA names no instruction set; unset it or use "
                    "scalar, sse4, avx2, avx512, neon or best"};
        if (isa == Isa::best) isa = best_isa();
    }
    if (!kernels_of(isa))
        return {StatusCode::unsupported,
                "no context made: this build or machine lacks the instruction set asked for; "
                "use Isa::best, and unset NUSSELT_ISA or set it to best"};
    try {
        Context* context = make<Context>(desc.allocator, desc.allocator);
        context->executor = desc.executor.enqueue ? desc.executor : serial_executor();
        context->profiler = desc.profiler;
        context->clock = desc.clock;
        context->isa = isa;
        context->kernels = kernels_of(isa);
        context->output_kernels = kernels::output_kernels_for(static_cast<kernels::Set>(isa));
        context->light_kernels = kernels::light_kernels_for(static_cast<kernels::Set>(isa));
        context->fading_kernels = kernels::fading_kernels_for(static_cast<kernels::Set>(isa));
        *out = context;
    } catch (const std::bad_alloc&) {
        return {StatusCode::out_of_memory,
                "no context made: the allocator gave no memory; free some and try again"};
    }
    return {};
}

Status destroy_context(Context* context) {
    if (!context) return {};
    {
        const std::lock_guard lock(context->guard);
        for (const Frame* frame : context->frames) {
            if (frame->in_flight)
                return {StatusCode::busy, "the context lives on: a frame is in flight; wait for it first"};
        }
    }
    for (Frame* frame : context->frames)
        unmake(context->allocator, frame);
    for (Crew* crew : context->crews)
        unmake(context->allocator, crew);
    for (size_t i = 0; i < context->meshes.size(); ++i) {
        MeshData* const data = context->meshes[i].data;
        const auto shares = [&](const MeshSlot& other) { return other.data == data; };
        if (data && std::none_of(context->meshes.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                                 context->meshes.end(), shares))
            unmake(context->allocator, data);
    }
    for (uint32_t q = 0; q < quality_count; ++q) {
        if (context->tables[q]) release_tables(static_cast<Quality>(q));
    }
    const Allocator allocator = context->allocator;
    unmake(allocator, context);
    return {};
}

uint32_t first_generation(const Context& context) {
    // Fibonacci hashing of the address: contexts that live at a time have addresses of their own.
    const uint64_t mixed = (reinterpret_cast<uintptr_t>(&context) >> 6) * 0x9E3779B97F4A7C15u;
    return static_cast<uint32_t>(mixed >> 33) | 1; // the upper half is left to count in
}

Isa context_isa(const Context* context) {
    return context ? context->isa : Isa::scalar;
}

} // namespace nusselt
