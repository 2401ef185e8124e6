#include "nusselt/nusselt.h"
#include "tests/fuzz/fuzz.h"
#include "tests/jobs/executors.h"

#include <cmath>
#include <mutex>
#include <thread>
#include <vector>

namespace nusselt::fuzz {

namespace {

// A wavy strip.
struct Shape {
    std::vector<float> positions, normals;
    std::vector<uint32_t> indices;

    explicit Shape(uint32_t kind) {
        const uint32_t quads = 1 + kind % 5 * 7;
        for (uint32_t v = 0; v < 2 * (quads + 1); ++v) {
            const float x = float(v / 2), y = float(v % 2);
            positions.insert(positions.end(), {x, y, std::sin(x * float(1 + kind % 3))});
            normals.insert(normals.end(), {0, 0, 1});
        }
        for (uint32_t q = 0; q < quads; ++q) {
            for (const uint32_t i : {0u, 2u, 3u, 0u, 3u, 1u})
                indices.push_back(2 * q + i);
        }
    }
    size_t count() const { return positions.size() / 3; }
};

const Shape& shape(uint32_t kind) {
    static const std::vector<Shape> all = [] {
        std::vector<Shape> made;
        for (uint32_t k = 0; k < 16; ++k)
            made.emplace_back(k);
        return made;
    }();
    return all[kind % 16];
}

struct Added {
    MeshId id;
    uint32_t kind;
};

struct Shared {
    Context* context = nullptr;
    std::mutex guard;
    std::vector<Added> meshes;        // some of them gone
    std::vector<HistoryId> histories; // some of them gone
};

bool one_of(Status status, std::initializer_list<StatusCode> codes) {
    for (const StatusCode code : codes) {
        if (status.code == code) return true;
    }
    return false;
}

struct Flight {
    FrameId id;
    std::vector<float> positions, transfer, back;
    std::vector<uint32_t> masks;
    std::vector<uint8_t> packed;
    nusselt::Output stream;
    size_t count;
    bool cancelled = false;
};

void finish(Shared& shared, Flight& flight) {
    FrameStats stats;
#if defined(NUSSELT_PLANT)
    // A host that frees what a frame has borrowed, now and then.
    if (flight.count > 40) std::vector<float>().swap(flight.transfer);
#endif
    expect(wait(shared.context, flight.id, &stats).ok(), "a frame in flight is waited for");
    expect(one_of(wait(shared.context, flight.id, nullptr), {StatusCode::stale_handle}),
           "a frame is waited for once");
    expect(flight.cancelled || stats.receivers_written == stats.receivers, "a whole frame is written");
    expect(stats.receivers_written <= stats.receivers, "no more is written than there is");
    for (const float t : flight.transfer)
        expect(std::isfinite(t), "transfer is finite");
    for (const float t : flight.back)
        expect(std::isfinite(t), "transfer of backs is finite");
    for (const FrameId gone : {flight.id, FrameId{}}) {
        bool done = false;
        expect(one_of(cancel(shared.context, gone), {StatusCode::stale_handle}) &&
                   one_of(poll(shared.context, gone, &done), {StatusCode::stale_handle}),
               "a frame that is gone is told");
    }
}

// Bits of an operation, beside its number.
constexpr uint8_t with_history = 8, watertight = 16, more = 32, draft = 64, fading = 128;

// The frame of a mesh, with whatever the bits ask for. Whether it may be refused as impossible.
bool describe(Shared& shared, Bytes& in, uint8_t op, const Added& mesh, Flight& flight, FrameMesh& use,
              FrameDesc& desc) {
    const Shape& s = shape(mesh.kind);
    flight.positions = s.positions;
    flight.count = s.count();
    for (uint32_t i = in.below(4); i > 0; --i)
        flight.positions[in.below(uint32_t(flight.positions.size()))] = in.raw_float();
    flight.transfer.resize(25 * s.count());
    use = {mesh.id,
           {flight.positions.data(), s.count(), 12},
           {s.normals.data(), s.count(), 12},
           {flight.transfer.data(), s.count(), 100},
           {}};
    desc = {&use, 1, op & draft ? Quality::draft : Quality::standard};
    if (op & fading) desc.falloff = {in.raw_float(), in.raw_float()};
    desc.watertight = op & watertight;
    if (op & with_history) {
        const std::lock_guard lock(shared.guard);
        if (!shared.histories.empty())
            desc.history = shared.histories[in.below(uint32_t(shared.histories.size()))];
        if (in.byte() & 1) desc.budget_us = 1;
    }
    if (op & more) {
        const uint8_t what = in.byte();
        if (what & 1) {
            flight.masks.resize(32 * s.count());
            use.masks = {flight.masks.data(), s.count(), 128};
        }
        if (what & 2) {
            flight.back.resize(25 * s.count());
            use.back.transfer = {flight.back.data(), s.count(), 100};
        }
        if (what & 4) {
            flight.stream = {};
            flight.stream.kind = OutputKind(what >> 3 & 7); // two of eight are none
            flight.stream.format = OutputFormat(what >> 6 & 3);
            flight.packed.resize(4 * 75 * s.count());
            flight.stream.data = flight.packed.data();
            flight.stream.count = s.count();
            use.outputs = &flight.stream;
            use.output_count = 1;
        }
        desc.order = 1 + in.below(6); // 6 is none
        flight.transfer.resize(25 * s.count());
    }
    return op & (fading | with_history | watertight | more);
}

void thread(Shared& shared, Bytes in) {
    std::vector<Flight> flights;
    flights.reserve(64);
    while (!in.empty()) {
        const uint8_t op = in.byte();
        const auto any = [&] {
            const std::lock_guard lock(shared.guard);
            return shared.meshes.empty() ? Added{{}, 0}
                                         : shared.meshes[in.below(uint32_t(shared.meshes.size()))];
        };
        switch (op % 8) {
        case 0: {
            const uint32_t kind = in.byte();
            const Shape& s = shape(kind);
            Added added{{}, kind};
            expect(add_mesh(shared.context,
                            {{s.positions.data(), s.count(), 12}, {}, s.indices.data(), s.indices.size()},
                            &added.id)
                       .ok(),
                   "a mesh is added");
            const std::lock_guard lock(shared.guard);
            shared.meshes.push_back(added);
            break;
        }
        case 1: {
            if (op & with_history) {
                const std::lock_guard lock(shared.guard);
                if (shared.histories.empty()) break;
                const HistoryId history = shared.histories[in.below(uint32_t(shared.histories.size()))];
                expect(one_of(remove_history(shared.context, history),
                              {StatusCode::ok, StatusCode::stale_handle, StatusCode::busy}),
                       "removing a history answers");
                break;
            }
            const Added mesh = any();
            const Status status = remove_mesh(shared.context, mesh.id);
            expect(one_of(status, {StatusCode::ok, StatusCode::stale_handle, StatusCode::busy}),
                   "removing answers");
            break;
        }
        case 2:
        case 3:
        case 4: {
            if (flights.size() >= 64) break;
            const Added mesh = any();
            Flight& flight = flights.emplace_back();
            FrameMesh use;
            FrameDesc desc;
            const bool odd = describe(shared, in, op, mesh, flight, use, desc);
            const Status status = submit(shared.context, desc, &flight.id);
            expect(one_of(status, {StatusCode::ok, StatusCode::stale_handle, StatusCode::busy}) ||
                       (odd && one_of(status, {StatusCode::invalid_argument, StatusCode::unsupported})),
                   "submitting answers");
            if (!status.ok()) flights.pop_back();
            break;
        }
        case 5: {
            if (flights.empty()) break;
            Flight& flight = flights.back();
            bool done = false;
            if (op & more) {
                expect(one_of(destroy_context(shared.context), {StatusCode::busy}),
                       "a context with a frame in flight stays");
            }
            if (op & watertight)
                expect(poll(shared.context, flight.id, &done).ok(), "a frame in flight is polled");
            if (op & with_history) {
                expect(cancel(shared.context, flight.id).ok(), "a frame in flight is cancelled");
                flight.cancelled = true;
            }
            finish(shared, flight);
            flights.pop_back();
            break;
        }
        case 6: {
            if (op & with_history) {
                HistoryId history;
                expect(create_history(shared.context, &history).ok(), "a history is made");
                const std::lock_guard lock(shared.guard);
                shared.histories.push_back(history);
                break;
            }
            MeshInfo info;
            const MeshId odd{in.word(), in.word()};
            expect(one_of(mesh_info(shared.context, op & 64 ? odd : any().id, &info),
                          {StatusCode::ok, StatusCode::stale_handle}),
                   "asking answers");
            break;
        }
        default: {
            const uint32_t bad[3] = {0, 1, in.word() | 2};
            const float p[6] = {};
            MeshId id;
            expect(one_of(add_mesh(shared.context, {{p, 2, 12}, {}, bad, 3}, &id),
                          {StatusCode::invalid_argument}),
                   "a bad index is refused");
            break;
        }
        }
    }
    while (!flights.empty()) {
        finish(shared, flights.back());
        flights.pop_back();
    }
}

} // namespace

// The first byte chooses an executor and the number of threads, the rest is dealt out among them.
int api(const uint8_t* data, size_t size) {
    if (size < 4 || size > 600) return 0;
    // Keeps the tables from one input to the next.
    static const struct Keeper {
        Shared own;
        Keeper() {
            expect(create_context({}, &own.context).ok(), "a context is made");
            const uint8_t frames[] = {0, 0, 2, 0, 0, 5, 66, 0, 0, 5};
            thread(own, {frames, sizeof(frames)});
        }
        ~Keeper() { (void)destroy_context(own.context); }
    } keeper;
    static const std::vector<test::ExecutorOptions> executors = test::hostile_executors();
    test::TestExecutor executor(executors[data[0] % executors.size()]);
    Shared shared;
    ContextDesc desc;
    if (data[1] & 128) desc.executor = executor.hook();
    expect(create_context(desc, &shared.context).ok(), "a context is made");
    const size_t threads = 1 + data[1] % 4, part = (size - 2) / threads;
    std::vector<std::thread> pool;
    for (size_t t = 1; t < threads; ++t)
        pool.emplace_back([&shared, bytes = Bytes{data + 2 + t * part, part}] { thread(shared, bytes); });
    thread(shared, {data + 2, part});
    for (std::thread& t : pool)
        t.join();
    expect(destroy_context(shared.context).ok(), "a context without frames in flight is destroyed");
    std::string complaint = executor.broken();
    // It counts the tasks of all frames; the contract's bound is one frame's.
    const std::string bound = "more tasks queued than allowed; ";
    for (size_t at; (at = complaint.find(bound)) != std::string::npos;)
        complaint.erase(at, bound.size());
    if (!complaint.empty()) broken(("the executor contract is kept: " + complaint).c_str());
    return 0;
}

} // namespace nusselt::fuzz
