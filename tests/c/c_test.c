/* Every function of nusselt/c.h from C, and every way to misuse its structs. */
#include <nusselt/c.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int failures = 0;

#define EXPECT(condition)                                                                                    \
    do {                                                                                                     \
        if (!(condition)) {                                                                                  \
            printf("%s:%d: %s\n", __FILE__, __LINE__, #condition);                                           \
            ++failures;                                                                                      \
        }                                                                                                    \
    } while (0)

#define EXPECT_CODE(call, wanted)                                                                            \
    do {                                                                                                     \
        const nusselt_status status_ = (call);                                                               \
        if (status_.code != (wanted) || !status_.text || strlen(status_.text) < 2) {                         \
            printf("%s:%d: %s: %u %s\n", __FILE__, __LINE__, #call, (unsigned)status_.code, status_.text);   \
            ++failures;                                                                                      \
        }                                                                                                    \
    } while (0)

struct host {
    size_t held;
    unsigned tasks, zones;
    int open;
};

static void* host_allocate(void* user, size_t size, size_t alignment) {
    char* memory = malloc(size + alignment + sizeof(void*));
    char* aligned;
    if (!memory) return NULL;
    ((struct host*)user)->held += size;
    aligned = memory + sizeof(void*) + alignment;
    aligned -= (size_t)aligned % alignment;
    memcpy(aligned - sizeof(void*), &memory, sizeof(void*));
    return aligned;
}

static void host_release(void* user, void* memory, size_t size, size_t alignment) {
    void* start;
    (void)alignment;
    ((struct host*)user)->held -= size;
    memcpy(&start, (char*)memory - sizeof(void*), sizeof(void*));
    free(start);
}

static void* host_enqueue(void* user, void (*run)(void*), void* argument) {
    ++((struct host*)user)->tasks;
    run(argument);
    return NULL;
}

static void host_finish(void* user, void* ticket) {
    (void)user;
    (void)ticket;
}

static void host_begin(void* user, const char* zone) {
    ++((struct host*)user)->zones;
    ((struct host*)user)->open += zone != NULL;
}

static void host_end(void* user, const char* zone) {
    ((struct host*)user)->open -= zone != NULL;
}

/* A floor under a roof. */
static const float positions[8][3] = {{-1, 0, -1}, {1, 0, -1}, {1, 0, 1}, {-1, 0, 1},
                                      {-9, 1, -9}, {9, 1, -9}, {9, 1, 9}, {-9, 1, 9}};
static const float normals[8][3] = {{0, 1, 0}, {0, 1, 0}, {0, 1, 0}, {0, 1, 0},
                                    {0, 1, 0}, {0, 1, 0}, {0, 1, 0}, {0, 1, 0}};
static const uint32_t indices[12] = {0, 2, 1, 0, 3, 2, 4, 6, 5, 4, 7, 6};

static nusselt_mesh_desc mesh_desc(void) {
    nusselt_mesh_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.size = sizeof desc;
    desc.rest_positions.data = positions[0];
    desc.rest_positions.count = 8;
    desc.rest_normals.data = normals[0];
    desc.rest_normals.count = 8;
    desc.indices = indices;
    desc.index_count = 12;
    return desc;
}

static float transfer[8][25];
static uint32_t masks[8][32];
static nusselt_frame_mesh in;

static nusselt_frame_desc frame_desc(nusselt_mesh mesh) {
    nusselt_frame_desc desc;
    memset(&in, 0, sizeof in);
    in.mesh = mesh;
    in.positions.data = positions[0];
    in.positions.count = 8;
    in.normals.data = normals[0];
    in.normals.count = 8;
    in.transfer.data = transfer[0];
    in.transfer.count = 8;
    in.masks.data = masks[0];
    in.masks.count = 8;
    memset(&desc, 0, sizeof desc);
    desc.size = sizeof desc;
    desc.meshes = &in;
    desc.mesh_size = sizeof in;
    desc.mesh_count = 1;
    return desc;
}

static void test_frame(nusselt_context* context, nusselt_mesh mesh) {
    nusselt_frame_desc desc = frame_desc(mesh);
    nusselt_frame_stats stats;
    nusselt_frame frame, none = {0, 0};
    int done = 0;
    float light[75], rgb[24];
    nusselt_transfer_view view = {transfer[0], 8, 0};
    const nusselt_vec3_view white = {NULL, 0, 0};
    const float sky[3] = {1, 2, 3};
    uint64_t bad_pixels = 1;

    memset(&stats, 0, sizeof stats);
    stats.size = sizeof stats;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_OK);
    EXPECT_CODE(nusselt_poll(context, frame, &done), NUSSELT_OK);
    EXPECT(done == 1);
    EXPECT_CODE(nusselt_poll(context, frame, NULL), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_poll(context, none, &done), NUSSELT_STALE_HANDLE);
    EXPECT_CODE(nusselt_submit(context, &desc, &none), NUSSELT_BUSY);
    EXPECT_CODE(nusselt_remove_mesh(context, mesh), NUSSELT_BUSY);
    EXPECT_CODE(nusselt_destroy_context(context), NUSSELT_BUSY);
    EXPECT_CODE(nusselt_cancel(context, frame), NUSSELT_OK);
    --stats.size; /* a wrong size leaves the frame to be waited for */
    EXPECT_CODE(nusselt_wait(context, frame, &stats), NUSSELT_INVALID_ARGUMENT);
    ++stats.size;
    EXPECT_CODE(nusselt_wait(context, frame, &stats), NUSSELT_OK);
    EXPECT(stats.size == sizeof stats);
    EXPECT(stats.receivers == 8 && stats.receivers_written == 8);
    EXPECT_CODE(nusselt_wait(context, frame, NULL), NUSSELT_STALE_HANDLE);
    EXPECT_CODE(nusselt_cancel(context, frame), NUSSELT_STALE_HANDLE);

    EXPECT_CODE(nusselt_sh_project_latlong(sky, 1, 1, light, &bad_pixels), NUSSELT_OK);
    EXPECT(bad_pixels == 0);
    EXPECT_CODE(nusselt_sh_project_latlong(NULL, 1, 1, light, NULL), NUSSELT_INVALID_ARGUMENT);
    memset(light, 0, sizeof light);
    light[0] = 3.5449077f; /* radiance 1, 2, 3 from everywhere */
    light[1] = 2 * light[0];
    light[2] = 3 * light[0];
    EXPECT_CODE(nusselt_shade(context, light, 0, view, white, rgb), NUSSELT_OK);
    EXPECT(rgb[0] < 0.2f);                                            /* under the roof */
    EXPECT(fabsf(rgb[12] - 1) < 0.02f && fabsf(rgb[14] - 3) < 0.06f); /* on it */
    EXPECT_CODE(nusselt_shade(NULL, light, 0, view, white, rgb), NUSSELT_INVALID_ARGUMENT);
    view.stride = 3;
    EXPECT_CODE(nusselt_shade(context, light, 0, view, white, rgb), NUSSELT_INVALID_ARGUMENT);

    desc.quality = 77;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_INVALID_ARGUMENT);
    desc = frame_desc(mesh);
    desc.size = 0;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_INVALID_ARGUMENT);
    desc.size = sizeof desc + 8;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_UNSUPPORTED);
    desc = frame_desc(mesh);
    desc.mesh_size = 0;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_INVALID_ARGUMENT);
    desc = frame_desc(mesh);
    desc.meshes = NULL;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_INVALID_ARGUMENT);
    EXPECT(frame.generation == 0);
    EXPECT_CODE(nusselt_submit(context, NULL, &frame), NUSSELT_INVALID_ARGUMENT);
    desc = frame_desc(mesh);
    EXPECT_CODE(nusselt_submit(NULL, &desc, &frame), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_submit(context, &desc, NULL), NUSSELT_INVALID_ARGUMENT);
}

/* From above only the roof shows. */
static void test_needed(nusselt_context* context, nusselt_mesh mesh) {
    nusselt_frame_desc desc = frame_desc(mesh);
    const nusselt_vec3_view view = {positions[0], 8, 0};
    nusselt_camera camera;
    nusselt_frame_stats stats;
    nusselt_frame frame;
    uint32_t needed = 0;

    memset(&camera, 0, sizeof camera);
    camera.clip_from_position[0] = 0.1f; /* parallel, looking down: x to the right, z down */
    camera.clip_from_position[6] = -0.1f;
    camera.clip_from_position[15] = 1;
    camera.eye[1] = 1;
    EXPECT_CODE(nusselt_mark_visible(&camera, view, indices, 12, &needed), NUSSELT_INVALID_ARGUMENT);
    camera.size = sizeof camera;
    EXPECT_CODE(nusselt_mark_visible(NULL, view, indices, 12, &needed), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_mark_visible(&camera, view, indices + 6, 6, &needed), NUSSELT_OK);
    EXPECT(needed == 0xF0);
    transfer[0][0] = -7;
    in.needed = &needed;
    memset(&stats, 0, sizeof stats);
    stats.size = sizeof stats;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_OK);
    EXPECT_CODE(nusselt_wait(context, frame, &stats), NUSSELT_OK);
    EXPECT(stats.receivers == 4 && stats.receivers_unneeded == 4 && stats.receivers_copied == 0);
    EXPECT(transfer[0][0] == -7);
}

/* The same pose again costs nothing; a tight budget leaves results for later. */
static uint64_t slow_clock(void* user) {
    return *(uint64_t*)user += 1000000;
}

static void test_history(void) {
    const nusselt_mesh_desc mesh_of = mesh_desc();
    uint64_t now = 0;
    nusselt_context_desc with;
    nusselt_context* context = NULL;
    nusselt_mesh mesh;
    nusselt_history history;
    nusselt_frame_desc desc;
    nusselt_frame_stats stats;
    nusselt_frame frame;
    const float quarter[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1}; /* x to y */
    float light[75], turned[75];

    memset(&with, 0, sizeof with);
    with.size = sizeof with;
    with.clock.user = &now;
    with.clock.nanoseconds = slow_clock;
    EXPECT_CODE(nusselt_create_context(&with, &context), NUSSELT_OK);
    EXPECT_CODE(nusselt_add_mesh(context, &mesh_of, &mesh), NUSSELT_OK);
    EXPECT_CODE(nusselt_create_history(context, NULL), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_create_history(context, &history), NUSSELT_OK);
    memset(&stats, 0, sizeof stats);
    stats.size = sizeof stats;
    desc = frame_desc(mesh);
    desc.history = history;
    desc.order = 3;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_OK);
    EXPECT_CODE(nusselt_wait(context, frame, &stats), NUSSELT_OK);
    EXPECT(stats.receivers_computed == 8 && stats.receivers_reused == 0);
    desc.same_pose = 1;
    in.positions.data = in.normals.data = NULL;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_OK);
    EXPECT_CODE(nusselt_wait(context, frame, &stats), NUSSELT_OK);
    EXPECT(stats.receivers_computed == 0 && stats.receivers_reused == 8 && stats.receivers_written == 8);
    EXPECT(now == 0);
    desc = frame_desc(mesh);
    desc.history = history; /* of another order: anew */
    desc.budget_us = 1;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_OK);
    EXPECT_CODE(nusselt_wait(context, frame, &stats), NUSSELT_OK);
    EXPECT(stats.receivers_computed + stats.receivers_stale == 8 && stats.receivers_computed > 0);
    EXPECT(now > 0);
    EXPECT_CODE(nusselt_remove_history(context, history), NUSSELT_OK);
    EXPECT_CODE(nusselt_remove_history(context, history), NUSSELT_STALE_HANDLE);
    EXPECT_CODE(nusselt_destroy_context(context), NUSSELT_OK);

    memset(light, 0, sizeof light);
    light[3 * 1] = 1; /* y of the world is x of the object */
    nusselt_turn_light(quarter, light, turned);
    EXPECT(fabsf(turned[3 * 3] - 1) < 1e-6f && fabsf(turned[3 * 1]) < 1e-6f);
}

static void test_visible_set(nusselt_context* context, nusselt_mesh mesh) {
    nusselt_frame_desc desc = frame_desc(mesh);
    nusselt_visible_set *set = NULL, *read = NULL;
    nusselt_frame frame;
    size_t size;
    void* file;
    EXPECT_CODE(nusselt_create_visible_set(context, &mesh, 1, desc.quality, 2, NULL), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_create_visible_set(context, &mesh, 1, desc.quality, 2, &set), NUSSELT_OK);
    EXPECT(nusselt_visible_set_segments(set) == 2 && nusselt_visible_set_segments(NULL) == 0);
    desc.record = set;
    desc.visible_segment = 1;
    desc.watertight = 1;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_OK);
    EXPECT_CODE(nusselt_wait(context, frame, NULL), NUSSELT_OK);
    size = nusselt_visible_set_bytes(set);
    file = malloc(size);
    EXPECT_CODE(nusselt_write_visible_set(set, file, size - 1), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_write_visible_set(set, file, size), NUSSELT_OK);
    EXPECT_CODE(nusselt_read_visible_set(context, &mesh, 1, file, size - 4, &read), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_read_visible_set(context, &mesh, 1, file, size, &read), NUSSELT_OK);
    desc.record = NULL;
    desc.visible = read;
    EXPECT_CODE(nusselt_submit(context, &desc, &frame), NUSSELT_OK);
    EXPECT_CODE(nusselt_wait(context, frame, NULL), NUSSELT_OK);
    nusselt_destroy_visible_set(context, set);
    nusselt_destroy_visible_set(context, read);
    free(file);
}

/* More meshes than fit the stack, each of them small. */
static void test_many(nusselt_context* context) {
    enum { count = 100 };
    static nusselt_frame_mesh meshes[count];
    static float each[count][8][25];
    const nusselt_mesh_desc desc = mesh_desc();
    nusselt_frame_desc frame;
    nusselt_frame id;
    unsigned i;
    for (i = 0; i < count; ++i) {
        frame = frame_desc(in.mesh);
        meshes[i] = in;
        EXPECT_CODE(nusselt_add_mesh(context, &desc, &meshes[i].mesh), NUSSELT_OK);
        meshes[i].transfer.data = each[i][0];
        meshes[i].masks.data = NULL;
    }
    frame.meshes = meshes;
    frame.mesh_count = count;
    EXPECT_CODE(nusselt_submit(context, &frame, &id), NUSSELT_OK);
    EXPECT_CODE(nusselt_wait(context, id, NULL), NUSSELT_OK);
    EXPECT(each[count - 1][4][0] != 0);
    for (i = 0; i < count; ++i)
        EXPECT_CODE(nusselt_remove_mesh(context, meshes[i].mesh), NUSSELT_OK);
}

static void test_context(const nusselt_context_desc* context_desc) {
    nusselt_context* context = NULL;
    nusselt_mesh_desc desc = mesh_desc();
    nusselt_mesh mesh;
    nusselt_mesh_info info;
    size_t held, peak;

    EXPECT_CODE(nusselt_create_context(context_desc, &context), NUSSELT_OK);
    EXPECT(nusselt_context_isa(context) >= NUSSELT_ISA_SCALAR);
    EXPECT(strlen(nusselt_isa_name(nusselt_context_isa(context))) >= 4);

    EXPECT_CODE(nusselt_mesh_memory_bound(context, &desc, &held, &peak), NUSSELT_OK);
    EXPECT_CODE(nusselt_mesh_memory_bound(context, &desc, &held, NULL), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_add_mesh(context, &desc, &mesh), NUSSELT_OK);
    memset(&info, 0, sizeof info);
    EXPECT_CODE(nusselt_get_mesh_info(context, mesh, &info), NUSSELT_INVALID_ARGUMENT); /* no size */
    info.size = sizeof info;
    EXPECT_CODE(nusselt_get_mesh_info(context, mesh, &info), NUSSELT_OK);
    EXPECT(info.vertices == 8 && info.triangles == 4 && info.components == 2 && info.level_triangles[0] == 4);
    EXPECT(info.bytes > 0 && info.bytes <= held && held <= peak);
    EXPECT_CODE(nusselt_get_mesh_info(context, mesh, NULL), NUSSELT_INVALID_ARGUMENT);

    test_frame(context, mesh);
    test_needed(context, mesh);
    test_history();
    test_visible_set(context, mesh);
    test_many(context);

    EXPECT_CODE(nusselt_remove_mesh(context, mesh), NUSSELT_OK);
    EXPECT_CODE(nusselt_remove_mesh(context, mesh), NUSSELT_STALE_HANDLE);
    desc.size = 1;
    EXPECT_CODE(nusselt_add_mesh(context, &desc, &mesh), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_mesh_memory_bound(context, &desc, &held, &peak), NUSSELT_INVALID_ARGUMENT);
    desc.size = sizeof desc + 1;
    EXPECT_CODE(nusselt_add_mesh(context, &desc, &mesh), NUSSELT_UNSUPPORTED);
    desc = mesh_desc();
    desc.index_count = 11;
    EXPECT_CODE(nusselt_add_mesh(context, &desc, &mesh), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_add_mesh(context, NULL, &mesh), NUSSELT_INVALID_ARGUMENT);
    EXPECT_CODE(nusselt_destroy_context(context), NUSSELT_OK);
}

static void check_outputs(void) {
    const float gold[3] = {1.0f, 0.77f, 0.34f};
    unsigned char packed[32] = {0};
    float window[5], light[75], unpacked[25];
    nusselt_material metal = nusselt_metallic_roughness(gold, 1, 0.5f);
    EXPECT(metal.brdf == NUSSELT_BRDF_GGX && metal.specular[1] == 0.77f && metal.diffuse[1] == 0);
    EXPECT(nusselt_lobe_beyond_bands(&metal, 5) < nusselt_lobe_beyond_bands(&metal, 3));
    EXPECT(nusselt_sharpest_roughness(4096) < nusselt_sharpest_roughness(1024));
    EXPECT(nusselt_output_bytes(NUSSELT_OUTPUT_TRANSFER, NUSSELT_FORMAT_PACKED8, 0) == 32);
    EXPECT(nusselt_output_bytes(NUSSELT_OUTPUT_GLOSSY, NUSSELT_FORMAT_FLOAT16, 3) == 54);
    packed[1] = 0x34; /* the half 0.25 */
    nusselt_unpack_transfer(packed, 5, unpacked);
    EXPECT(unpacked[0] == 0.25f && unpacked[24] == 0);
    nusselt_sh_window(NUSSELT_WINDOW_HANN, 5, window);
    EXPECT(window[0] == 1 && window[4] > 0 && window[4] < window[3]);
    memset(light, 0, sizeof(light));
    light[74] = 1;
    nusselt_sh_apply_window(window, 3, light);
    EXPECT(light[74] == window[4]);
}

int main(void) {
    check_outputs();
    struct host host;
    nusselt_context_desc desc;
    nusselt_context* context = NULL;
    nusselt_executor tbb;
    nusselt_status status;
    float basis[25], turned[25];
    const float turn[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1}; /* a right angle about z */
    int i;

    EXPECT(nusselt_version() == NUSSELT_C_VERSION);
    EXPECT_CODE(nusselt_check_version(NUSSELT_C_VERSION), NUSSELT_OK);
    EXPECT_CODE(nusselt_check_version(NUSSELT_C_VERSION + 100), NUSSELT_UNSUPPORTED);
    EXPECT(strstr(nusselt_configuration(), "nusselt") != NULL);
    EXPECT(nusselt_quality_mask_bits(NUSSELT_QUALITY_DEFAULT) == 1024);
    EXPECT(nusselt_quality_mask_bits(NUSSELT_QUALITY_FINE) == 4096);
    EXPECT(nusselt_quality_mask_bits(9) == 0);
    EXPECT(strcmp(nusselt_isa_name(NUSSELT_ISA_BEST), "best") == 0);
    EXPECT(strcmp(nusselt_isa_name(NUSSELT_ISA_AVX2), "avx2") == 0);
    EXPECT(strcmp(nusselt_isa_name(9), "unknown") == 0);

    nusselt_sh_evaluate(1, 0, 0, basis);
    nusselt_sh_rotate(turn, basis, turned);
    nusselt_sh_evaluate(0, 1, 0, basis);
    for (i = 0; i < 25; ++i)
        EXPECT(fabsf(basis[i] - turned[i]) < 1e-5f);

    test_context(NULL);

    memset(&host, 0, sizeof host);
    memset(&desc, 0, sizeof desc);
    desc.size = sizeof desc;
    test_context(&desc);
    desc.allocator.user = desc.executor.user = desc.profiler.user = &host;
    desc.allocator.allocate = host_allocate;
    desc.allocator.release = host_release;
    desc.executor.enqueue = host_enqueue;
    desc.executor.finish = host_finish;
    desc.executor.concurrency = 1;
    desc.profiler.begin = host_begin;
    desc.profiler.end = host_end;
    desc.isa = NUSSELT_ISA_SCALAR;
    test_context(&desc);
    EXPECT(host.tasks > 0 && host.zones > 8);
    EXPECT(host.held == 0 && host.open == 0);

    EXPECT_CODE(nusselt_create_context(&desc, NULL), NUSSELT_INVALID_ARGUMENT);
    desc.isa = 99;
    EXPECT_CODE(nusselt_create_context(&desc, &context), NUSSELT_UNSUPPORTED);
    desc.isa = 0;
    desc.profiler.end = NULL;
    EXPECT_CODE(nusselt_create_context(&desc, &context), NUSSELT_INVALID_ARGUMENT);
    desc.size = 8;
    EXPECT_CODE(nusselt_create_context(&desc, &context), NUSSELT_INVALID_ARGUMENT);
    desc.size = sizeof desc + 8;
    EXPECT_CODE(nusselt_create_context(&desc, &context), NUSSELT_UNSUPPORTED);
    EXPECT(context == NULL);
    EXPECT_CODE(nusselt_destroy_context(NULL), NUSSELT_OK);

    EXPECT_CODE(nusselt_create_tbb_executor(2, NULL), NUSSELT_INVALID_ARGUMENT);
    status = nusselt_create_tbb_executor(2, &tbb);
    if (status.code == NUSSELT_OK) {
        memset(&desc, 0, sizeof desc);
        desc.size = sizeof desc;
        desc.executor = tbb;
        /* poll may come too early for `done`: the frames' own test is the C++ one's */
        EXPECT_CODE(nusselt_create_context(&desc, &context), NUSSELT_OK);
        EXPECT_CODE(nusselt_destroy_context(context), NUSSELT_OK);
        nusselt_destroy_executor(&tbb);
        EXPECT(tbb.enqueue == NULL);
    } else {
        EXPECT_CODE(status, NUSSELT_UNSUPPORTED);
    }
    nusselt_destroy_executor(NULL);
    if (!failures) puts("c_test: passed");
    return failures ? 1 : 0;
}
