#include "nusselt/nusselt.h"
#include "tests/fuzz/fuzz.h"
#include "tools/commands/commands.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <vector>

namespace nusselt::fuzz {

namespace {

namespace fs = std::filesystem;

// A folder of a few small files, for as long as the process lives.
struct Folder {
    fs::path path;
    Folder() {
        std::string name = (fs::temp_directory_path() / "nusselt-fuzz-XXXXXX").string();
        if (!mkdtemp(name.data())) std::abort();
        path = name;
        std::ofstream(path / "box.obj") << "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\nf 1 2 3 4\n";
        std::ofstream(path / "moving.gltf")
            << R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"name":"part"}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"buffers":[{"byteLength":68,"uri":"moving.bin"}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":8},
{"buffer":0,"byteOffset":44,"byteLength":24}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[1]},
{"bufferView":2,"componentType":5126,"count":2,"type":"VEC3"}],
"animations":[{"channels":[{"sampler":0,"target":{"node":0,"path":"translation"}}],
"samplers":[{"input":1,"output":2}]}]})";
        const float moving[17] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0};
        std::ofstream(path / "moving.bin", std::ios::binary)
            .write(reinterpret_cast<const char*>(moving), sizeof(moving));
        std::ofstream(path / "broken.glb") << "glTF, or so it says";
        std::ofstream(path / "light.hdr", std::ios::binary)
            << "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n"
            << std::string(32, '\x81');
    }
    ~Folder() {
        std::error_code ignored;
        fs::remove_all(path, ignored);
    }
};

// The program's own, and what it must not mistake for them.
const std::vector<std::string>& words() {
    static const std::vector<std::string> all = [] {
        std::istringstream text(R"(
info transfer render demo compare pvs study --help -h --version --json --out @out @box.obj @moving.gltf
@broken.glb @light.hdr @absent.gltf @moving.pvs @ --quality paper draft standard fine --threads --isa
scalar avx2 best --repeat --clip --time --env sky --frames --fps --shadows off on traced --rays --brdf
lambert phong:20:0.4 ggx:0.3:1 --size 1x1 8x8 0x0 x -1x2 9999x1 16x 0 1 2 -1 4294967296 1e9 nan inf 0.5
-- - --out= --quality=draft --output ambient_occlusion bent_normal bent_normal:packed8 transfer:packed8:2
direct transfer:float16:3 --pvs --segments --two-sided model all --watertight --light --falloff 0.1:0.5
0:0 1:0 inf:nan --with --at 1:2:3 --ground --receive-only --block-only --keep --show visible-set --model
--scene hand moon --quick ambient-occlusion sh glossy falloff static sides objects weather
)");
        std::vector<std::string> words{"", "\x1b[31m"};
        for (std::string word; text >> word;)
            words.push_back(word);
        return words;
    }();
    return all;
}

// All contexts share the tables of 1024 bits for as long as one has them: made once, not in every run.
struct Tables {
    Context* context = nullptr;
    Tables() {
        expect(create_context({}, &context).ok(), "a context is made");
        const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, normals[9] = {0, 0, 1, 0, 0, 1, 0, 0, 1};
        const uint32_t indices[3] = {0, 1, 2};
        float transfer[75];
        FrameMesh mesh;
        mesh.positions = {positions, 3, 12};
        mesh.normals = {normals, 3, 12};
        mesh.transfer = {transfer, 3, 100};
        expect(add_mesh(context, {mesh.positions, mesh.normals, indices, 3}, &mesh.mesh).ok(),
               "a mesh is added");
        FrameId frame;
        expect(submit(context, {&mesh, 1, Quality::standard}, &frame).ok() &&
                   wait(context, frame, nullptr).ok(),
               "a frame is made");
    }
    ~Tables() { (void)destroy_context(context); }
};

} // namespace

// Tokens of the program's own language: an exit code of 0, 1 or 2, and never a crash.
int cli(const uint8_t* data, size_t size) {
    static const Folder folder;
    static const Tables tables;
    Bytes in{data, std::min<size_t>(size, 24)};
    std::vector<std::string> arguments{"nusselt"};
    bool heavy = false, help = false;
    while (!in.empty()) {
        const uint8_t byte = in.byte();
        std::string word;
        if (byte < 250) {
            word = words()[byte % words().size()];
        } else {
            for (uint32_t i = in.below(12); i > 0; --i)
                word += char(std::max<uint8_t>(in.byte(), 1));
            if (word.starts_with("/") || word.find("..") != std::string::npos) word = "odd";
        }
        heavy = heavy || word == "demo" || word == "compare" || word == "study";
        // Each run would make their tables, a second and more with sanitizers.
        heavy = heavy || word == "direct" || word == "paper" || word == "fine";
        help = help || word == "--help" || word == "-h";
        if (word.starts_with("@")) word = (folder.path / word.substr(1)).string();
        arguments.push_back(word);
    }
    if (heavy && !help) return 0; // seconds of work
    std::vector<const char*> argv;
    for (const std::string& a : arguments)
        argv.push_back(a.c_str());
    argv.push_back(nullptr);
#if defined(NUSSELT_PLANT)
    // A name copied into an array that is long enough for all names there are.
    char copy[16];
    if (arguments.size() > 2 && arguments[1] == "render" && arguments[2].size() > 20) {
        volatile size_t length = arguments[2].size();
        for (size_t i = 0; i < length; ++i)
            static_cast<volatile char*>(copy)[i] = arguments[2][i];
    }
#endif
    // Any word may become the place for results.
    const fs::path home = fs::current_path();
    fs::current_path(folder.path);
    const int code = tools::run_program(int(arguments.size()), argv.data());
    fs::current_path(home);
    expect(code >= 0 && code <= 2, "an exit code is 0, 1 or 2");
    static const std::set<std::string> given{"box.obj", "moving.gltf", "moving.bin", "broken.glb",
                                             "light.hdr"};
    std::vector<fs::path> made;
    for (const auto& entry : fs::directory_iterator(folder.path)) {
        const std::string name = entry.path().filename().string();
        expect(!name.starts_with("."), "no half-written output is left");
        if (!given.count(name)) made.push_back(entry.path());
    }
    std::error_code ignored;
    for (const fs::path& path : made)
        fs::remove_all(path, ignored);
    return 0;
}

} // namespace nusselt::fuzz
