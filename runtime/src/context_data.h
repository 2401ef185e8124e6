// What the opaque Context holds.
#pragma once

#include "frame_data.h"
#include "nusselt/context.h"

#include <mutex>

namespace nusselt {

struct CellMemory {
    explicit CellMemory(const Allocator& a) : memory(HostAllocator<float>(a)) {}
    Vector<float> memory; // empty until used
    kernels::CellTables tables{};
};

struct FarMemory {
    explicit FarMemory(const Allocator& a) : table(HostAllocator<float>(a)) {}
    Vector<float> table; // empty until used
};

struct MeshSlot {
    MeshData* data = nullptr; // null: free
    MeshInfo info;
    uint32_t generation = 1;
    uint32_t frames = 0; // in flight that use it
};

struct Context {
    explicit Context(const Allocator& a)
        : allocator(a), cells{CellMemory(a), CellMemory(a), CellMemory(a), CellMemory(a)}, far{FarMemory(a),
                                                                                               FarMemory(a),
                                                                                               FarMemory(a),
                                                                                               FarMemory(a)},
          fade_directions{Vector<float>(HostAllocator<float>(a)), Vector<float>(HostAllocator<float>(a)),
                          Vector<float>(HostAllocator<float>(a)), Vector<float>(HostAllocator<float>(a))},
          meshes(HostAllocator<MeshSlot>(a)), frames(HostAllocator<Frame*>(a)),
          crews(HostAllocator<Crew*>(a)) {}

    Allocator allocator;
    Executor executor;
    Isa isa = Isa::scalar;
    Profiler profiler;
    Clock clock;
    const kernels::Kernels* kernels = nullptr;
    const kernels::OutputKernels* output_kernels = nullptr;
    const kernels::LightKernels* light_kernels = nullptr;
    const kernels::FadingKernels* fading_kernels = nullptr;
    const kernels::Tables* tables[quality_count] = {}; // held once used

    CellMemory cells[quality_count];              // for outputs that are made from masks
    FarMemory far[quality_count];                 // for frames of several objects
    Vector<float> fade_directions[quality_count]; // for frames with a falloff; empty until used

    std::mutex guard; // the slots and counts below; never held while a frame works
    Vector<MeshSlot> meshes;
    Vector<Frame*> frames; // kept for later frames, and for histories; grown on demand
    Vector<Crew*> crews;   // kept for later frames; grown on demand
};

// Where the generations of a context's handles start: another context's handles are then told apart.
uint32_t first_generation(const Context& context);

// A zone of the host's profiler, for a scope.
struct Zone {
    Zone(const Profiler& p, const char* n) : profiler(p), name(n) {
        if (profiler.begin) profiler.begin(profiler.user, name);
    }
    ~Zone() {
        if (profiler.begin) profiler.end(profiler.user, name);
    }
    Zone(const Zone&) = delete;
    Zone& operator=(const Zone&) = delete;

    const Profiler& profiler;
    const char* name;
};

// The live mesh of that handle, or null. The guard is held.
MeshSlot* find_mesh(Context& context, MeshId mesh);

// From the allocator, constructed; throws std::bad_alloc.
template<class T, class... Arguments>
T* make(const Allocator& allocator, Arguments&&... arguments) {
    HostAllocator<T> host(allocator);
    T* memory = host.allocate(1);
    try {
        return new (memory) T(static_cast<Arguments&&>(arguments)...);
    } catch (...) {
        host.deallocate(memory, 1);
        throw;
    }
}

template<class T>
void unmake(const Allocator& allocator, T* object) {
    if (!object) return;
    object->~T();
    HostAllocator<T>(allocator).deallocate(object, 1);
}

} // namespace nusselt
