// Output streams through whole frames: what they hold, where they lie, and that their memory is only written.
#include "tests/runtime/fixture.h"

#include <nusselt/c.h>

#include <glm/glm.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>

#if defined(__x86_64__) && defined(__linux__)
#include <csignal>
#include <sys/mman.h>
#include <ucontext.h>
#endif

namespace nusselt::test::shader {

using namespace glm;
vec3 light[25];
#include "packed_transfer.glsl"

} // namespace nusselt::test::shader

namespace nusselt::test {

namespace {

using Stream = nusselt::Output;

Stream stream(OutputKind kind, OutputFormat format, void* data, size_t count, size_t stride = 0,
              uint32_t bands = 0) {
    Stream s;
    s.kind = kind;
    s.format = format;
    s.data = data;
    s.count = count;
    s.stride = stride;
    s.bands = bands;
    return s;
}

// One mesh with these streams, and no transfer unless given.
Status run(Context* context, const Posed& mesh, const std::vector<Stream>& streams,
           TransferView transfer = {}, FrameStats* stats = nullptr) {
    FrameMesh m;
    m.mesh = mesh.mesh;
    m.positions = view(mesh.positions);
    m.normals = view(mesh.normals);
    m.transfer = transfer;
    m.outputs = streams.data();
    m.output_count = uint32_t(streams.size());
    FrameDesc desc;
    desc.meshes = &m;
    desc.mesh_count = 1;
    FrameId id;
    const Status started = submit(context, desc, &id);
    if (!started.ok()) return started;
    return wait(context, id, stats);
}

// The hand's first pose, with some vertices twice.
scenes::Mesh hand_with_duplicates() {
    const scenes::Scene scene = scenes::builtin("hand");
    scenes::Pose pose;
    scene.pose(0, pose);
    scenes::Mesh mesh = scene.meshes[0];
    mesh.rest_positions = pose.positions[0];
    mesh.rest_normals = pose.normals[0];
    for (size_t v = 0; v < 300; ++v) {
        const size_t from = 7 * v;
        mesh.rest_positions.push_back(mesh.rest_positions[from]);
        mesh.rest_normals.push_back(mesh.rest_normals[from]);
    }
    return mesh;
}

struct Difference {
    double mean = 0, p99 = 0, most = 0;
};
Difference relative(const std::vector<std::array<float, 25>>& exact,
                    const std::vector<std::array<float, 25>>& other) {
    std::vector<double> all;
    for (size_t v = 0; v < exact.size(); ++v) {
        double square = 0, size = 0;
        for (uint32_t i = 0; i < 25; ++i) {
            square += std::pow(double(exact[v][i]) - double(other[v][i]), 2);
            size += std::pow(double(exact[v][i]), 2);
        }
        if (exact[v][0] > 0.0028f) all.push_back(std::sqrt(square / size)); // sees 1 %
    }
    Difference d;
    std::sort(all.begin(), all.end());
    for (const double e : all)
        d.mean += e / double(all.size());
    d.p99 = all[all.size() * 99 / 100];
    d.most = all.back();
    return d;
}

TEST(Outputs, HoldWhatTheTransferSays) {
    Engine engine;
    const scenes::Mesh mesh = hand_with_duplicates();
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const size_t count = mesh.rest_positions.size();
    const Outputs full = run_frame(engine.context, {posed});
    const auto& transfer = full.meshes[0].transfer;

    // Interleaved as a vertex buffer would be, between bytes that stay.
    constexpr size_t stride = 200;
    std::vector<uint8_t> buffer(count * stride + 8, 0xCC);
    std::vector<std::array<float, 25>> floats(count);
    std::vector<std::array<uint8_t, 32>> packed(count);
    uint8_t* const base = buffer.data() + 4;
    const std::vector<Stream> streams = {
        stream(OutputKind::ambient_occlusion, OutputFormat::float32, base, count, stride),
        stream(OutputKind::bent_normal, OutputFormat::float32, base + 4, count, stride),
        stream(OutputKind::ambient_occlusion, OutputFormat::packed8, base + 19, count, stride),
        stream(OutputKind::bent_normal, OutputFormat::packed8, base + 16, count, stride),
        stream(OutputKind::transfer, OutputFormat::float16, base + 20, count, stride),
        stream(OutputKind::transfer, OutputFormat::float32, base + 72, count, stride, 3),
        stream(OutputKind::transfer, OutputFormat::float32, floats.data(), count),
        stream(OutputKind::transfer, OutputFormat::packed8, packed.data(), count)};
    FrameStats stats;
    ASSERT_TRUE(run(engine.context, posed, streams, {}, &stats).ok());
    EXPECT_EQ(stats.receivers, count);
    EXPECT_EQ(stats.receivers_written, count);
    EXPECT_LE(stats.receivers_computed, count - 300);
    EXPECT_EQ(std::memcmp(floats.data(), transfer.data(), count * 100), 0);
    std::vector<std::array<float, 25>> unpacked(count);
    for (size_t v = 0; v < count; ++v) {
        const uint8_t* element = base + v * stride;
        float ao, bent[3], three[9];
        std::memcpy(&ao, element, 4);
        std::memcpy(bent, element + 4, 12);
        std::memcpy(three, element + 72, 36);
        ASSERT_NEAR(ao, std::min(transfer[v][0] * 3.5449077f, 1.0f), 1e-6f);
        ASSERT_NEAR(std::hypot(bent[0], bent[1], bent[2]), 1, 1e-5f);
        ASSERT_NEAR(element[19], ao * 255, 0.501f);
        for (int k = 0; k < 3; ++k)
            ASSERT_NEAR(int8_t(element[16 + k]), bent[k] * 127, 0.501f);
        ASSERT_EQ(std::memcmp(three, transfer[v].data(), 36), 0);
        for (size_t i = 108; i < stride; ++i)
            ASSERT_EQ(element[i], 0xCC) << v;
        unpack_transfer(packed[v].data(), 5, unpacked[v].data());
    }
    for (size_t i = 0; i < 4; ++i) {
        EXPECT_EQ(buffer[i], 0xCC);
        EXPECT_EQ(buffer[buffer.size() - 1 - i], 0xCC);
    }
    const Difference d = relative(transfer, unpacked);
    std::printf("    packed to 32 bytes: mean %.3f %% p99 %.3f %% most %.3f %%\n", 100 * d.mean, 100 * d.p99,
                100 * d.most);
    EXPECT_LE(d.mean, 0.002);
    EXPECT_LE(d.p99, 0.01);
}

// The docs' shader, word for word.
TEST(Outputs, TheShaderReadsWhatIsPacked) {
    Engine engine;
    const scenes::Mesh mesh = hand_with_duplicates();
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const size_t count = mesh.rest_positions.size();
    std::vector<std::array<glm::uvec4, 2>> packed(count);
    ASSERT_TRUE(run(engine.context, posed,
                    {stream(OutputKind::transfer, OutputFormat::packed8, packed.data(), count)}, {}, nullptr)
                    .ok());
    Random random(11);
    for (glm::vec3& l : shader::light)
        l = {random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)};
    for (size_t v = 0; v < count; ++v) {
        float transfer[25];
        unpack_transfer(packed[v].data(), 5, transfer);
        glm::vec3 sum(0);
        for (size_t i = 0; i < 25; ++i)
            sum += shader::light[i] * transfer[i];
        const glm::vec3 seen = shader::radiance(packed[v][0], packed[v][1]);
        for (int c = 0; c < 3; ++c)
            ASSERT_NEAR(seen[c], sum[c], 2e-6f) << v;
    }
}

TEST(Outputs, BesideTransferAndOnEveryInstructionSet) {
    const scenes::Mesh mesh = hand_with_duplicates();
    const size_t count = mesh.rest_positions.size();
    std::vector<uint8_t> first;
    Outputs alone;
    for (const Isa isa : available_isas()) {
        Engine engine(with_isa(isa));
        const Posed posed = at_rest(add(engine.context, mesh), mesh);
        if (first.empty()) alone = run_frame(engine.context, {posed});
        std::vector<std::array<float, 25>> transfer(count);
        std::vector<uint8_t> bytes(count * (32 + 4));
        Stream window = stream(OutputKind::transfer, OutputFormat::packed8, bytes.data(), count);
        sh_window(ShWindow::hann, 6, window.window);
        const std::vector<Stream> streams = {
            window, stream(OutputKind::bent_normal, OutputFormat::packed8, bytes.data() + 32 * count, count),
            stream(OutputKind::ambient_occlusion, OutputFormat::packed8, bytes.data() + 35 * count, count)};
        ASSERT_TRUE(run(engine.context, posed, streams, {transfer[0].data(), count, 100}).ok());
        EXPECT_EQ(transfer, alone.meshes[0].transfer) << isa_name(isa);
        if (first.empty()) first = bytes;
        EXPECT_EQ(bytes, first) << isa_name(isa);
    }
}

// A wall through the receiver's place hides the half with x > 0 of a hemisphere about z.
TEST(Outputs, HalfHidden) {
    Engine engine;
    const scenes::Mesh receiver = points({{0, 0, 0}}, {{0, 0, 1}});
    const scenes::Mesh wall = wall_beside();
    const MeshId ids[2] = {add(engine.context, receiver), add(engine.context, wall)};
    float ao = 0, bent[3] = {};
    const Stream streams[2] = {stream(OutputKind::ambient_occlusion, OutputFormat::float32, &ao, 1),
                               stream(OutputKind::bent_normal, OutputFormat::float32, bent, 1)};
    FrameMesh meshes[2];
    meshes[0].mesh = ids[0];
    meshes[0].positions = view(receiver.rest_positions);
    meshes[0].normals = view(receiver.rest_normals);
    meshes[0].outputs = streams;
    meshes[0].output_count = 2;
    meshes[1].mesh = ids[1];
    meshes[1].positions = view(wall.rest_positions);
    meshes[1].normals = view(wall.rest_normals);
    FrameDesc desc;
    desc.meshes = meshes;
    desc.mesh_count = 2;
    FrameId id;
    ASSERT_TRUE(submit(engine.context, desc, &id).ok());
    ASSERT_TRUE(wait(engine.context, id, nullptr).ok());
    EXPECT_NEAR(ao, 0.5, 0.02);
    // Mean of s over the half, weighted by the cosine: x = -4 / (3 pi), z = 2 / 3.
    const double x = -4 / (3 * 3.14159265358979), z = 2.0 / 3, length = std::hypot(x, z);
    EXPECT_NEAR(bent[0], x / length, 0.02);
    EXPECT_NEAR(bent[1], 0, 0.02);
    EXPECT_NEAR(bent[2], z / length, 0.02);
}

// Vertices that were one when the mesh was added and look differently now are receivers of their own.
TEST(Outputs, RepeatedVerticesWhoseNormalsPart) {
    Engine engine;
    const scenes::Mesh mesh = hand_with_duplicates();
    Posed posed = at_rest(add(engine.context, mesh), mesh);
    const size_t count = mesh.rest_positions.size();
    for (size_t v = count - 300; v < count; v += 2)
        posed.normals[v] = -posed.normals[v];
    std::vector<std::array<float, 25>> floats(count);
    const Outputs full = run_frame(engine.context, {posed});
    FrameStats stats;
    ASSERT_TRUE(run(engine.context, posed,
                    {stream(OutputKind::transfer, OutputFormat::float32, floats.data(), count)}, {}, &stats)
                    .ok());
    EXPECT_EQ(floats, full.meshes[0].transfer);
    EXPECT_EQ(stats.receivers_written, count);
    EXPECT_NE(floats[count - 300], floats[0]);
    EXPECT_EQ(floats[count - 299], floats[7]);
}

// A history's kept results make the same streams as computed ones.
TEST(Outputs, WithAHistory) {
    Engine engine;
    const scenes::Mesh mesh = hand_with_duplicates();
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const size_t count = mesh.rest_positions.size();
    std::vector<std::array<uint8_t, 32 + 12 + 12>> first(count), second(count);
    HistoryId history;
    ASSERT_TRUE(create_history(engine.context, &history).ok());
    float light[75];
    Random random(7);
    for (float& c : light)
        c = random.between(0, 1);
    const auto frame = [&](std::vector<std::array<uint8_t, 56>>& out, HistoryId id) {
        constexpr size_t stride = 56;
        const std::vector<Stream> streams = {
            stream(OutputKind::bent_normal, OutputFormat::float32, out[0].data(), count, stride),
            stream(OutputKind::radiance, OutputFormat::float32, out[0].data() + 12, count, stride),
            stream(OutputKind::transfer, OutputFormat::packed8, out[0].data() + 24, count, stride)};
        FrameMesh m;
        m.mesh = posed.mesh;
        m.positions = view(posed.positions);
        m.normals = view(posed.normals);
        m.outputs = streams.data();
        m.output_count = uint32_t(streams.size());
        FrameDesc desc;
        desc.meshes = &m;
        desc.mesh_count = 1;
        desc.history = id;
        desc.light = light;
        FrameId frame_id;
        FrameStats stats;
        const Status started = submit(engine.context, desc, &frame_id);
        EXPECT_TRUE(started.ok()) << started.text;
        if (started.ok()) {
            EXPECT_TRUE(wait(engine.context, frame_id, &stats).ok());
        }
        return stats;
    };
    frame(first, {});
    EXPECT_GT(frame(second, history).receivers_computed, 0u);
    EXPECT_EQ(first, second);
    second.assign(count, {});
    const FrameStats kept = frame(second, history);
    EXPECT_EQ(kept.receivers_computed, 0u);
    EXPECT_EQ(kept.receivers_written, count);
    EXPECT_EQ(first, second);
    light[0] += 1; // light alone changes
    frame(first, {});
    EXPECT_EQ(frame(second, history).receivers_computed, 0u);
    EXPECT_EQ(first, second);
}

TEST(Outputs, RefusedDescriptions) {
    Engine engine;
    const scenes::Mesh mesh = points({{0, 0, 0}}, {{0, 0, 1}});
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    alignas(8) uint8_t memory[256] = {};
    const Stream good = stream(OutputKind::transfer, OutputFormat::float16, memory, 1);
    const auto code = [&](const Stream& s) { return run(engine.context, posed, {s}).code; };
    EXPECT_EQ(code(good), StatusCode::ok);
    Stream s = good;
    s.kind = OutputKind(3);
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    s = good;
    s.format = OutputFormat(3);
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    s = good;
    s.bands = 6;
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    s = good;
    s.data = nullptr;
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    s = good;
    s.count = 2;
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    s = good;
    s.stride = 48;
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    s = good;
    s.stride = 51;
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    s = good;
    s.data = memory + 1;
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    for (const float factor : {-0.1f, 1.1f, std::nanf("")}) {
        s = good;
        std::fill_n(s.window, 5, 1.0f);
        s.window[3] = factor;
        EXPECT_EQ(code(s), StatusCode::invalid_argument) << factor;
    }
    s = good;
    s.window[0] = 0.5f;
    EXPECT_EQ(code(s), StatusCode::invalid_argument);
    FrameMesh m;
    m.mesh = posed.mesh;
    m.positions = view(posed.positions);
    m.normals = view(posed.normals);
    m.output_count = 1;
    FrameDesc desc;
    desc.meshes = &m;
    desc.mesh_count = 1;
    FrameId id;
    EXPECT_EQ(submit(engine.context, desc, &id).code, StatusCode::invalid_argument);
    EXPECT_EQ(output_bytes(OutputKind::transfer, OutputFormat::packed8), 32u);
    EXPECT_EQ(output_bytes(OutputKind::bent_normal, OutputFormat::float16), 6u);
    EXPECT_EQ(output_bytes(OutputKind::transfer, OutputFormat::float16, 6), 0u);
    EXPECT_EQ(output_bytes(OutputKind(9), OutputFormat::float16), 0u);
}

TEST(Outputs, Windows) {
    float w[5];
    sh_window(ShWindow::hann, 4, w);
    EXPECT_EQ(w[0], 1.0f);
    EXPECT_NEAR(w[1], 0.5 + 0.5 * std::sqrt(0.5), 1e-6);
    EXPECT_NEAR(w[2], 0.5, 1e-6);
    EXPECT_EQ(w[4], 0.0f);
    sh_window(ShWindow::lanczos, 4, w);
    EXPECT_NEAR(w[2], 2 / 3.14159265, 1e-6);
    for (const float width : {0.0f, -1.0f, std::nanf("")}) {
        sh_window(ShWindow::lanczos, width, w);
        EXPECT_EQ(w[0], 1.0f);
        for (int l = 1; l < 5; ++l)
            EXPECT_EQ(w[l], 0.0f);
    }
    sh_window(ShWindow::hann, INFINITY, w);
    for (const float f : w)
        EXPECT_EQ(f, 1.0f);
    float light[75];
    std::fill_n(light, 75, 2.0f);
    const float half[5] = {1, 0.5f, 0.25f, 0.125f, 0};
    sh_apply_window(half, 3, light);
    EXPECT_EQ(light[2], 2.0f);
    EXPECT_EQ(light[3], 1.0f);
    EXPECT_EQ(light[11], 1.0f);
    EXPECT_EQ(light[12], 0.5f);
    EXPECT_EQ(light[74], 0.0f);
}

TEST(Outputs, ThroughTheCInterface) {
    Engine engine;
    const scenes::Mesh mesh = hand_with_duplicates();
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const size_t count = mesh.rest_positions.size();
    std::vector<float> ours(count), theirs(count);
    ASSERT_TRUE(run(engine.context, posed,
                    {stream(OutputKind::ambient_occlusion, OutputFormat::float32, ours.data(), count)})
                    .ok());
    nusselt_output output{};
    output.kind = NUSSELT_OUTPUT_AMBIENT_OCCLUSION;
    output.data = theirs.data();
    output.count = count;
    nusselt_frame_mesh m{};
    m.mesh = {posed.mesh.slot, posed.mesh.generation};
    m.positions = {&posed.positions[0].x, count, 0};
    m.normals = {&posed.normals[0].x, count, 0};
    m.outputs = &output;
    m.output_count = 1;
    nusselt_frame_desc desc{};
    desc.size = sizeof(desc);
    desc.meshes = &m;
    desc.mesh_size = sizeof(m);
    desc.mesh_count = 1;
    auto* const context = reinterpret_cast<nusselt_context*>(engine.context);
    nusselt_frame frame;
    EXPECT_EQ(nusselt_submit(context, &desc, &frame).code, NUSSELT_INVALID_ARGUMENT); // no output_size
    m.output_size = sizeof(output);
    ASSERT_EQ(nusselt_submit(context, &desc, &frame).code, NUSSELT_OK);
    ASSERT_EQ(nusselt_wait(context, frame, nullptr).code, NUSSELT_OK);
    EXPECT_EQ(ours, theirs);
}

#if defined(__x86_64__) && defined(__linux__) && !defined(NUSSELT_SANITIZED)

// Memory that faults at every access; the processor says which kind it was, and the access is let through by
// a single step.
struct Watched {
    char* memory = nullptr;
    size_t size = 0;
    uint64_t reads = 0, writes = 0;
};
Watched watched;

void on_fault(int, siginfo_t* info, void* context) {
    auto* const u = static_cast<ucontext_t*>(context);
    const char* at = static_cast<const char*>(info->si_addr);
    if (at < watched.memory || at >= watched.memory + watched.size) _exit(70);
    constexpr greg_t write_bit = 2, trap_flag = 0x100;
    ++(u->uc_mcontext.gregs[REG_ERR] & write_bit ? watched.writes : watched.reads);
    mprotect(watched.memory, watched.size, PROT_READ | PROT_WRITE);
    u->uc_mcontext.gregs[REG_EFL] |= trap_flag;
}
void on_step(int, siginfo_t*, void* context) {
    static_cast<ucontext_t*>(context)->uc_mcontext.gregs[REG_EFL] &= ~greg_t(0x100);
    mprotect(watched.memory, watched.size, PROT_NONE);
}

TEST(Outputs, MemoryIsOnlyWritten) {
    Engine engine;
    scenes::Mesh mesh; // 256 places, each twice; the streams are the point
    for (uint32_t v = 0; v < 512; ++v) {
        mesh.rest_positions.emplace_back(float(v % 256), 0, 0);
        mesh.rest_normals.emplace_back(0, 0, 1);
    }
    const Posed posed = at_rest(add(engine.context, mesh), mesh);
    const size_t count = mesh.rest_positions.size();
    const size_t bytes = count * (100 + 32 + 1 + 6);
    watched.size = (bytes + 4095) / 4096 * 4096;
    watched.memory =
        static_cast<char*>(mmap(nullptr, watched.size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
    ASSERT_NE(watched.memory, MAP_FAILED);
    struct sigaction fault {
    }, step{}, old_fault{}, old_step{};
    fault.sa_sigaction = on_fault;
    step.sa_sigaction = on_step;
    fault.sa_flags = step.sa_flags = SA_SIGINFO;
    sigaction(SIGSEGV, &fault, &old_fault);
    sigaction(SIGTRAP, &step, &old_step);
    char* const m = watched.memory;
    const Status status =
        run(engine.context, posed,
            {stream(OutputKind::transfer, OutputFormat::packed8, m + 100 * count, count),
             stream(OutputKind::bent_normal, OutputFormat::float16, m + 132 * count, count),
             stream(OutputKind::ambient_occlusion, OutputFormat::packed8, m + 138 * count, count)},
            {reinterpret_cast<float*>(m), count, 100});
    const uint64_t reads = watched.reads, writes = watched.writes;
    const volatile char seen = m[0]; // the watch works
    sigaction(SIGSEGV, &old_fault, nullptr);
    sigaction(SIGTRAP, &old_step, nullptr);
    munmap(watched.memory, watched.size);
    (void)seen;
    EXPECT_TRUE(status.ok()) << status.text;
    EXPECT_EQ(reads, 0u);
    EXPECT_GT(writes, 4 * count);
    EXPECT_EQ(watched.reads, 1u);
}

#endif

} // namespace

} // namespace nusselt::test
