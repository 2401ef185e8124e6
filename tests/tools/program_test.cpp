// The program's contract, from outside: exit codes, messages, and outputs that are there whole or not at all.
#include "nusselt/version.h"
#include "tools/report/base64.h"
#include "tools/trace/sh.h"
#include "tools/trace/trace.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

namespace nusselt::tools {
namespace {

namespace fs = std::filesystem;

std::string contents(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

// Two ticks of a triangle that moves along x, for a second. A leaf shows the camera its back.
std::string moving_triangle(bool leaf = false) {
    const float positions[9] = {
        0, 0, 0, leaf ? 0.0f : 1.0f, leaf ? 1.0f : 0.0f, 0, leaf ? 1.0f : 0.0f, leaf ? 0.0f : 1.0f, 0};
    const float times[2] = {0, 1}, moves[6] = {0, 0, 0, 2, 0, 0};
    std::string bytes;
    bytes.append(reinterpret_cast<const char*>(positions), 36);
    bytes.append(reinterpret_cast<const char*>(times), 8);
    bytes.append(reinterpret_cast<const char*>(moves), 24);
    return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"materials":[{"doubleSided":)" +
           std::string(leaf ? "true" : "false") + R"(}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}],
"buffers":[{"byteLength":68,"uri":"data:application/octet-stream;base64,)" +
           base64(bytes) + R"("}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":8},
{"buffer":0,"byteOffset":44,"byteLength":24}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[1]},
{"bufferView":2,"componentType":5126,"count":2,"type":"VEC3"}],
"animations":[{"name":"slide","channels":[{"sampler":0,"target":{"node":0,"path":"translation"}}],
"samplers":[{"input":1,"output":2}]}]})";
}

// A square, `lower`, and the same above it, `upper`: two nodes that draw one mesh.
std::string two_meshes(const std::string& upper = "upper") {
    const float positions[12] = {0, 0, 0, 0, 0, 2, 2, 0, 2, 2, 0, 0};
    const uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    std::string bytes;
    bytes.append(reinterpret_cast<const char*>(positions), 48);
    bytes.append(reinterpret_cast<const char*>(indices), 12);
    return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
"nodes":[{"mesh":0,"name":"lower"},{"mesh":0,"name":")" +
           upper + R"(","translation":[0.3,0.8,-0.3]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"buffers":[{"byteLength":60,"uri":"data:application/octet-stream;base64,)" +
           base64(bytes) + R"("}],
"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":12}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[2,0,2]},
{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}]})";
}

// The same with a third square that lies below, face down, where none sees another, and is above the others
// for the last fifth of a second.
std::string visited_squares() {
    const float positions[12] = {0, 0, 0, 0, 0, 2, 2, 0, 2, 2, 0, 0};
    const uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    const float times[3] = {0, 0.8f, 1}, moves[9] = {0, -0.8f, 0, 1.2f, 1.6f, 0, 1.2f, 1.6f, 0};
    const float turns[12] = {1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1};
    std::string bytes;
    bytes.append(reinterpret_cast<const char*>(positions), 48);
    bytes.append(reinterpret_cast<const char*>(indices), 12);
    bytes.append(reinterpret_cast<const char*>(times), 12);
    bytes.append(reinterpret_cast<const char*>(moves), 36);
    bytes.append(reinterpret_cast<const char*>(turns), 48);
    return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1,2]}],
"nodes":[{"mesh":0},{"mesh":0,"translation":[0.3,0.8,-0.3]},{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"buffers":[{"byteLength":156,"uri":"data:application/octet-stream;base64,)" +
           base64(bytes) + R"("}],
"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":12},
{"buffer":0,"byteOffset":60,"byteLength":12},{"buffer":0,"byteOffset":72,"byteLength":36},
{"buffer":0,"byteOffset":108,"byteLength":48}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[2,0,2]},
{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"},
{"bufferView":2,"componentType":5126,"count":3,"type":"SCALAR","min":[0],"max":[1]},
{"bufferView":3,"componentType":5126,"count":3,"type":"VEC3"},
{"bufferView":4,"componentType":5126,"count":3,"type":"VEC4"}],
"animations":[{"name":"visit","channels":[{"sampler":0,"target":{"node":2,"path":"translation"}},
{"sampler":1,"target":{"node":2,"path":"rotation"}}],
"samplers":[{"input":2,"output":3,"interpolation":"STEP"},{"input":2,"output":4,"interpolation":"STEP"}]}]})";
}

struct Outcome {
    int code = -1;
    std::string out, err;
};

// What each failing command line of these tests ends with, by the letter: messages.tsv beside this file, of
// an exit code, the command line and the line on stderr. The parser's own words are those of CLI11 2.1, which
// Debian 12 has. NUSSELT_WRITE_MESSAGES=1 writes the file anew from what all these tests see.
class Messages {
public:
    Messages() {
        std::ifstream file(NUSSELT_MESSAGES);
        for (std::string code, command, message; std::getline(file, code, '\t') &&
                                                 std::getline(file, command, '\t') &&
                                                 std::getline(file, message);)
            lines[command] = {code, message};
    }
    ~Messages() {
        if (!is_written) return;
        std::ofstream file(NUSSELT_MESSAGES);
        for (const auto& [command, line] : seen)
            file << line.first << '\t' << command << '\t' << line.second << '\n';
    }
    void compare(const std::string& command, int code, const std::string& err) {
        std::pair line{std::to_string(code), err.substr(0, err.find('\n'))};
        const std::string own = "this machine has ";
        if (const size_t at = line.second.find(own); at != std::string::npos)
            line.second.replace(at + own.size(), std::string::npos, "...");
        seen[command] = line;
        if (is_written || is_foreign(line.second)) return;
        ASSERT_TRUE(lines.count(command)) << "not in messages.tsv: " << command;
        EXPECT_EQ(line, lines[command]) << command;
    }
    // After all tests: a line that none provokes says nothing of the program.
    void expect_all_seen() const {
        if (is_written) return;
        for (const auto& [command, line] : lines)
            EXPECT_TRUE(seen.count(command)) << "no test provokes this line of messages.tsv: " << command;
    }

private:
    // The parser's own words, of a version other than the file's.
    bool is_foreign(const std::string& message) const {
        return !are_known && message.starts_with("nusselt: usage: ");
    }
    std::map<std::string, std::pair<std::string, std::string>> lines, seen;
    const bool is_written = std::getenv("NUSSELT_WRITE_MESSAGES") != nullptr;
    const bool are_known = std::string(NUSSELT_CLI11).starts_with("2.1.");
};

class Program : public testing::Test {
protected:
    static Messages& messages() {
        static Messages all;
        return all;
    }
    static void TearDownTestSuite() {
        const auto& tests = *testing::UnitTest::GetInstance();
        if (tests.test_to_run_count() == tests.total_test_count() && tests.Passed())
            messages().expect_all_seen();
    }

    fs::path folder;

    void SetUp() override {
        std::string name = (fs::temp_directory_path() / "nusselt-program-XXXXXX").string();
        folder = mkdtemp(name.data());
        std::ofstream(folder / "slide.gltf") << moving_triangle();
        std::ofstream(folder / "leaf.gltf") << moving_triangle(true);
        // A box, outside counter-clockwise, and a lid over it.
        std::ofstream(folder / "box.obj")
            << "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
               "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
               "v -1 -1 1.5\nv 2 -1 1.5\nv 2 2 1.5\nv -1 2 1.5\nf 9 10 11 12\n";
        std::ofstream(folder / "boxes.gltf") << two_meshes();
        std::ofstream(folder / "twins.gltf") << two_meshes("lower");
        std::ofstream(folder / "visit.gltf") << visited_squares();
        // A floor and a wall behind it.
        std::ofstream(folder / "corner.obj") << "v 0 0 0\nv 0 0 2\nv 2 0 2\nv 2 0 0\nf 1 2 3 4\n"
                                                "v 0 -1 0.2\nv 2 -1 0.2\nv 2 2 0.2\nv 0 2 0.2\nf 5 6 7 8\n";
        std::ofstream(folder / "broken.glb") << "glTF, or so it says";
        std::ofstream(folder / "light.hdr", std::ios::binary)
            << "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n"
            << std::string(32, '\x81');
    }
    void TearDown() override {
        std::error_code ignored;
        fs::remove_all(folder, ignored);
    }

    // Relative names in `arguments` lie in the test's folder.
    Outcome run(const std::string& arguments, const std::string& environment = {}) {
        const std::string command =
            "cd '" + folder.string() + "' && " + environment + " '" NUSSELT_PROGRAM "' " + arguments + " >'" +
            (folder / "stdout").string() + "' 2>'" + (folder / "stderr").string() + "'";
        const int status = std::system(command.c_str());
        return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, contents(folder / "stdout"),
                contents(folder / "stderr")};
    }

    // One line on stderr that holds all of `parts`, and no `out`.
    void expect_failure(int code, const std::string& arguments, const std::vector<std::string>& parts,
                        const std::string& environment = {}) {
        const Outcome result = run(arguments, environment);
        EXPECT_EQ(result.code, code) << arguments << '\n' << result.err;
        EXPECT_TRUE(result.err.starts_with("nusselt: ")) << result.err;
        EXPECT_EQ(result.err.find('\n'), result.err.size() - 1) << result.err;
        for (const std::string& part : parts)
            EXPECT_NE(result.err.find(part), std::string::npos) << arguments << '\n' << result.err;
        EXPECT_EQ(result.out, "") << arguments;
        messages().compare(environment + (environment.empty() ? "" : " ") + "nusselt" +
                               (arguments.empty() ? "" : " ") + arguments,
                           result.code, result.err);
        EXPECT_FALSE(fs::exists(folder / "out")) << arguments;
        for (const fs::directory_entry& entry : fs::directory_iterator(folder))
            EXPECT_FALSE(entry.path().filename().string().starts_with(".")) << entry.path();
    }

    std::vector<float> floats(const std::string& name) {
        const std::string bytes = contents(folder / name);
        const size_t start = bytes.find('\n') + 1;
        std::vector<float> values((bytes.size() - start) / 4);
        std::memcpy(values.data(), bytes.data() + start, values.size() * 4);
        return values;
    }
};

TEST_F(Program, Help) {
    const Outcome help = run("--help");
    EXPECT_EQ(help.code, 0);
    EXPECT_EQ(help.err, "");
    for (const char* command : {"demo", "info", "transfer", "render"}) {
        EXPECT_NE(help.out.find(command), std::string::npos) << command;
        const Outcome own = run(std::string(command) + " --help");
        EXPECT_EQ(own.code, 0);
        EXPECT_GT(own.out.size(), 100u) << command;
    }
    const Outcome render = run("render --help");
    for (const char* option : {"--out", "--env", "--clip", "--time", "--frames", "--fps", "--shadows",
                               "--brdf", "--size", "--quality", "--threads", "--isa", "--rays"})
        EXPECT_NE(render.out.find(option), std::string::npos) << option;
    EXPECT_NE(run("--version").out.find("nusselt"), std::string::npos);
}

TEST_F(Program, UsageErrors) {
    expect_failure(2, "", {"subcommand"});
    expect_failure(2, "paint", {"paint"});
    expect_failure(2, "transfer", {"--help"});
    expect_failure(2, "transfer box.obj", {"--out"});
    expect_failure(2, "transfer box.obj --out out --speed 9", {"--speed"});
    expect_failure(2, "transfer box.obj --out out --quality superb",
                   {"superb", "paper, draft, standard, fine"});
    expect_failure(2, "transfer box.obj --out out --isa mmx", {"mmx", "scalar"});
    expect_failure(2, "transfer box.obj --out out", {"NUSSELT_ISA", "mmx", "scalar"}, "NUSSELT_ISA=mmx");
    expect_failure(2, "transfer box.obj --out out --threads 0", {"--threads"});
    expect_failure(2, "transfer box.obj --out out --threads many", {"many"});
    expect_failure(2, "transfer box.obj --out out --repeat 0", {"--repeat"});
    expect_failure(2, "transfer box.obj --out ''", {"--out"});
    expect_failure(2, "render box.obj --out out --size 9", {"--size", "WIDTHxHEIGHT"});
    expect_failure(2, "render box.obj --out out --size 0x9", {"--size"});
    expect_failure(2, "render box.obj --out out --brdf glass", {"glass", "lambert"});
    expect_failure(2, "render box.obj --out out --shadows some", {"some", "off, on, traced"});
    expect_failure(2, "render slide.gltf --out out --time 0 --frames 2", {"--frames"});
    expect_failure(2, "render slide.gltf --out out --frames 2 --fps 0", {"--fps"});
    expect_failure(2, "compare --scene moon --out out", {"moon"});
    expect_failure(2, "compare --scene hand --out out --threads none", {"none"});
    expect_failure(2, "compare --scene hand --out out --frames 0", {"--frames"});
    expect_failure(2, "demo --threads -1 --out out", {"-1"});
    expect_failure(2, "render box.obj --out out --falloff 2:1", {"--falloff"});
    expect_failure(2, "render box.obj --out out --light candle", {"candle"});
    expect_failure(2, "transfer box.obj --out out --output haze", {"haze"});
    expect_failure(2, "transfer box.obj --out out --output transfer:packed8:9", {"9"});
    expect_failure(2, "info box.obj broken.glb", {"broken.glb"});
}

TEST_F(Program, ClipsAndTimesOutsideAreListed) {
    expect_failure(2, "transfer slide.gltf --out out --clip jump", {"jump", "0 'slide' (1 s)"});
    expect_failure(2, "transfer slide.gltf --out out --clip 1", {"'1'", "0 'slide'"});
    expect_failure(2, "transfer box.obj --out out --clip 0", {"has none"});
    expect_failure(2, "transfer slide.gltf --out out --time 1.5", {"1.5 s", "lasts 1 s"});
    expect_failure(2, "transfer slide.gltf --out out --time -1", {"-1 s"});
    expect_failure(2, "transfer slide.gltf --out out --time nan", {"--time"});
    expect_failure(2, "transfer box.obj --out out --time 1", {"stands still"});
    expect_failure(2, "render slide.gltf --out out --frames 32", {"31 frames"});
    expect_failure(2, "render box.obj --out out --frames 2", {"stands still"});
}

TEST_F(Program, BadInput) {
    expect_failure(1, "info broken.glb", {"broken.glb: "});
    expect_failure(1, "transfer broken.glb --out out", {"broken.glb: "});
    expect_failure(1, "transfer missing.gltf --out out", {"missing.gltf: "});
    expect_failure(1, "transfer . --out out", {".: "});
    expect_failure(1, "render broken.glb --out out", {"broken.glb: "});
    expect_failure(1, "render box.obj --out out --env box.obj", {"box.obj: ", ".hdr"});
    expect_failure(1, "render box.obj --out out --env missing.hdr", {"missing.hdr: "});
}

TEST_F(Program, UnwritableOutput) {
    expect_failure(1, "transfer box.obj --out box.obj", {"box.obj: ", "not a directory"});
    expect_failure(1, "transfer box.obj --out box.obj/out", {"box.obj/out: "});
    expect_failure(1, "render box.obj --out /proc/no/where", {"/proc/no/where: "});
    expect_failure(1, "demo --quick --out /proc/no/where", {"/proc/no/where: "});
    const std::string full =
        "'" NUSSELT_PROGRAM "' info '" + (folder / "box.obj").string() + "' >/dev/full 2>/dev/null";
    const int status = std::system(full.c_str());
    EXPECT_EQ(WEXITSTATUS(status), 1);
}

TEST_F(Program, TransferWritesArraysAndStats) {
    const Outcome result = run("transfer box.obj --out out --threads 1 --repeat 3");
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(result.err, "");
    const auto stats = nlohmann::json::parse(contents(folder / "out" / "stats.json"));
    const size_t vertices = stats["vertices"], triangles = stats["triangles"];
    EXPECT_EQ(triangles, 14u);
    EXPECT_EQ(stats["quality"], "standard");
    EXPECT_EQ(stats["threads"], 1);
    EXPECT_LE(stats["frame_ms"]["min"], stats["frame_ms"]["median"]);
    EXPECT_GT(stats["us_per_vertex"]["min"], 0);
    EXPECT_EQ(stats["counts"]["receivers"], vertices);
    EXPECT_TRUE(stats["stage_ms"].contains("raster"));

    const auto header = [&](const std::string& name) {
        return contents(folder / "out" / name).substr(10, 70);
    };
    const std::string v = std::to_string(vertices);
    EXPECT_NE(header("positions.npy").find("'<f4', 'fortran_order': False, 'shape': (" + v + ", 3)"),
              std::string::npos);
    EXPECT_NE(header("normals.npy").find("'<f4', 'fortran_order': False, 'shape': (" + v + ", 3)"),
              std::string::npos);
    EXPECT_NE(header("indices.npy").find("'<u4', 'fortran_order': False, 'shape': (14, 3)"),
              std::string::npos);
    EXPECT_NE(header("transfer.npy").find("'<f4', 'fortran_order': False, 'shape': (" + v + ", 25)"),
              std::string::npos);
    EXPECT_NE(header("masks.npy").find("'<u4', 'fortran_order': False, 'shape': (" + v + ", 32)"),
              std::string::npos);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder / "out"), {}), 6);

    // The box's bottom sees everything, its top the lid.
    const std::vector<float> positions = floats("out/positions.npy"), normals = floats("out/normals.npy"),
                             transfer = floats("out/transfer.npy");
    int open = 0, covered = 0;
    for (size_t k = 0; k < vertices; ++k) {
        const float seen = static_cast<float>(seen_part(&transfer[k * 25]));
        if (normals[3 * k + 2] < -0.3f && positions[3 * k + 2] < 1) open += seen > 0.99f;
        if (normals[3 * k + 2] > 0.3f && positions[3 * k + 2] == 1) covered += seen < 0.8f;
    }
    EXPECT_GE(open, 4);
    EXPECT_GE(covered, 4);
}

TEST_F(Program, SameBitsForThreadsAndInstructionSets) {
    // More than one thread is told, not made, where the build has no TBB.
    const int threads = has_feature(Feature::tbb) ? 2 : 1;
    EXPECT_EQ(run("transfer box.obj --out a --threads 2").code, threads == 2 ? 0 : 1);
    ASSERT_EQ(run("transfer box.obj --out a --threads " + std::to_string(threads)).code, 0);
    ASSERT_EQ(run("transfer box.obj --out b --threads 1 --isa scalar").code, 0);
    ASSERT_EQ(run("transfer box.obj --out c --threads 1", "NUSSELT_ISA=scalar").code, 0);
    for (const char* name : {"transfer.npy", "masks.npy"}) {
        EXPECT_EQ(contents(folder / "a" / name), contents(folder / "b" / name)) << name;
        EXPECT_EQ(contents(folder / "a" / name), contents(folder / "c" / name)) << name;
    }
    for (const char* out : {"b", "c"})
        EXPECT_EQ(nlohmann::json::parse(contents(folder / out / "stats.json"))["isa"], "scalar");
}

TEST_F(Program, TimeMovesTheModel) {
    ASSERT_EQ(run("transfer slide.gltf --out a").code, 0);
    ASSERT_EQ(run("transfer slide.gltf --out b --clip slide --time 0.5").code, 0);
    ASSERT_EQ(run("transfer slide.gltf --out c --time 1").code, 0);
    EXPECT_EQ(floats("a/positions.npy")[0], 0.0f);
    EXPECT_EQ(floats("b/positions.npy")[0], 1.0f);
    EXPECT_EQ(floats("c/positions.npy")[0], 2.0f);
    EXPECT_EQ(nlohmann::json::parse(contents(folder / "c" / "stats.json"))["clip"], "slide");
}

TEST_F(Program, QualitiesHaveTheirMasks) {
    for (const auto& [quality, words] :
         {std::pair("paper", 32), {"draft", 32}, {"standard", 32}, {"fine", 128}}) {
        const Outcome result = run(std::string("transfer box.obj --out out --quality ") + quality);
        if (result.code == 1 && std::string(quality) != "standard") continue; // said to be unsupported
        EXPECT_EQ(result.code, 0) << quality << result.err;
        EXPECT_NE(contents(folder / "out" / "masks.npy").find(", " + std::to_string(words) + ")"),
                  std::string::npos);
    }
}

TEST_F(Program, Render) {
    ASSERT_EQ(run("render box.obj --out out --size 40x30").code, 0);
    const std::string png = contents(folder / "out" / "frame_0000.png");
    EXPECT_TRUE(png.starts_with("\x89PNG\r\n\x1a\n"));
    EXPECT_EQ(png.substr(16, 8), std::string("\0\0\0\x28\0\0\0\x1e", 8));
    for (const char* mode : {"off", "on", "traced"}) {
        const Outcome result =
            run(std::string("render corner.obj --size 40x30 --env light.hdr --rays 64 --shadows ") + mode +
                " --out " + mode);
        EXPECT_EQ(result.code, 0) << result.err;
        EXPECT_EQ(result.err, "");
    }
    EXPECT_TRUE(contents(folder / "off" / "frame_0000.png") != contents(folder / "on" / "frame_0000.png"));
    ASSERT_EQ(run("render slide.gltf --out clip --size 40x30 --frames 3 --fps 2").code, 0);
    EXPECT_TRUE(contents(folder / "clip" / "frame_0000.png") != contents(folder / "clip" / "frame_0001.png"));
    EXPECT_TRUE(fs::exists(folder / "clip" / "frame_0002.png"));
    EXPECT_FALSE(fs::exists(folder / "clip" / "frame_0003.png"));
}

TEST_F(Program, OutputStreams) {
    expect_failure(2, "transfer box.obj --out out --output depth", {"depth", "ambient_occlusion"});
    expect_failure(2, "transfer box.obj --out out --output transfer:float8", {"float8", "packed8"});
    expect_failure(2, "transfer box.obj --out out --output transfer:float16:6", {"'6'"});
    expect_failure(2, "transfer box.obj --out out --output bent_normal:float16:3", {"'3'"});
    const Outcome result =
        run("transfer box.obj --out out --output ambient_occlusion --output transfer:packed8 "
            "--output transfer:float16:3 --output bent_normal:packed8");
    ASSERT_EQ(result.code, 0) << result.err;
    const auto stats = nlohmann::json::parse(contents(folder / "out" / "stats.json"));
    const std::string v = std::to_string(stats["vertices"].get<size_t>());
    const auto holds = [&](const std::string& name, const std::string& type, const std::string& columns) {
        const std::string header = contents(folder / "out" / (name + ".npy")).substr(10, 70);
        EXPECT_NE(header.find("'" + type + "'"), std::string::npos) << header;
        EXPECT_NE(header.find("(" + v + ", " + columns + ")"), std::string::npos) << header;
    };
    holds("ambient_occlusion_float32", "<f4", "1");
    holds("transfer_packed8", "|u1", "32");
    holds("transfer_float16_3", "<f2", "9");
    holds("bent_normal_packed8", "|i1", "3");
    ASSERT_EQ(stats["outputs"].size(), 4u);
    EXPECT_EQ(stats["outputs"][1]["bytes_a_vertex"], 32);
    EXPECT_LT(stats["outputs"][1]["format_error_mean"], 0.004);
    EXPECT_GT(stats["outputs"][1]["format_error_mean"], 0);
    EXPECT_LT(stats["outputs"][2]["format_error_mean"], 4e-4);
    const std::vector<float> seen = floats("out/ambient_occlusion_float32.npy"),
                             transfer = floats("out/transfer.npy");
    for (size_t k = 0; k < seen.size(); ++k)
        EXPECT_NEAR(seen[k], std::min(seen_part(&transfer[k * 25]), 1.0), 1e-5);
}

TEST_F(Program, RenderShowsLightAndWhatElseThereIs) {
    const std::string render = "render corner.obj --size 40x30 --env light.hdr --out ";
    expect_failure(2, render + "out --brdf chrome", {"chrome", "lambert", "ggx"});
    expect_failure(2, render + "out --brdf ggx:2", {"'2'"});
    expect_failure(2, render + "out --brdf phong:-1", {"'-1'"});
    expect_failure(2, render + "out --light moon", {"moon", "direct"});
    expect_failure(2, render + "out --light direct --shadows traced", {"--shadows"});
    expect_failure(2, render + "out --window box:3", {"box:3", "hann"});
    expect_failure(2, render + "out --falloff 2:1", {"2:1"});
    expect_failure(2, render + "out --falloff 1:2 --brdf ggx", {"--brdf"});
    expect_failure(2, render + "out --falloff 1:2 --watertight", {"--watertight"});
    expect_failure(2, render + "out --quality paper --watertight", {"--watertight"});
    expect_failure(2, render + "out --show depth", {"depth", "bent-normal"});
    expect_failure(2, render + "out --show bent-normal --shadows off", {"--shadows"});
    const auto picture = [&](const std::string& name, const std::string& options) {
        const Outcome result = run(render + name + " " + options);
        EXPECT_EQ(result.code, 0) << options << result.err;
        return contents(folder / name / "frame_0000.png");
    };
    const std::string plain = picture("plain", "");
    std::vector<std::string> others;
    for (const char* options :
         {"--brdf phong:10:0.5", "--brdf ggx:0.6:1", "--light direct", "--brdf ggx:0.3 --light direct",
          "--falloff 0.1:0.5", "--show ambient-occlusion", "--show bent-normal"})
        others.push_back(picture("p" + std::to_string(others.size()), options));
    for (size_t k = 0; k < others.size(); ++k) {
        EXPECT_NE(others[k], plain) << k;
        EXPECT_TRUE(others[k].starts_with("\x89PNG")) << k;
    }
    // A sharp lobe is told to ring; the traced and the unshadowed reference have materials too.
    EXPECT_NE(run(render + "sharp --brdf ggx:0.3:1").err.find("25 terms"), std::string::npos);
    EXPECT_EQ(run(render + "damped --brdf ggx:0.3:1 --window hann:6").err, "");
    EXPECT_EQ(run(render + "traced --brdf ggx:0.6:1 --shadows traced --rays 64").code, 0);
    EXPECT_EQ(run(render + "open --brdf model --shadows off").code, 0);
}

TEST_F(Program, BacksOfSheets) {
    expect_failure(2, "transfer box.obj --out out --two-sided both", {"both", "model"});
    expect_failure(2, "render box.obj --out out --two-sided both", {"both", "model"});
    // The lid over the box: its back sees the box.
    ASSERT_EQ(run("transfer box.obj --out lid --two-sided all --output ambient_occlusion").code, 0);
    const std::vector<float> front = floats("lid/ambient_occlusion_float32.npy"),
                             back = floats("lid/ambient_occlusion_float32_back.npy");
    ASSERT_EQ(front.size(), back.size());
    for (size_t v = front.size() - 4; v < front.size(); ++v) {
        EXPECT_NEAR(front[v], 1, 1e-4);
        EXPECT_LT(back[v], 0.999);
        EXPECT_GT(back[v], 0.8);
    }
    EXPECT_EQ(floats("lid/transfer_back.npy").size(), floats("lid/transfer.npy").size());
    EXPECT_EQ(contents(folder / "lid" / "masks_back.npy").size(),
              contents(folder / "lid" / "masks.npy").size());
    // What no material makes a sheet has no back.
    ASSERT_EQ(run("transfer box.obj --out none --two-sided model").code, 0);
    for (const float value : floats("none/transfer_back.npy"))
        EXPECT_EQ(value, 0);
    ASSERT_EQ(run("transfer leaf.gltf --out leaf --two-sided model").code, 0);
    for (size_t v = 0; v < 3; ++v)
        EXPECT_NEAR(floats("leaf/transfer_back.npy")[25 * v], 0.28209479, 1e-4);
    const auto picture = [&](const std::string& options) {
        EXPECT_EQ(run("render leaf.gltf --size 40x30 --out picture " + options).code, 0) << options;
        return contents(folder / "picture" / "frame_0000.png");
    };
    const std::string lit = picture("");
    EXPECT_NE(lit, picture("--two-sided off"));
    EXPECT_EQ(lit, picture("--two-sided all"));
    EXPECT_EQ(lit, picture("--shadows off")); // nothing hides anything
    EXPECT_NE(picture("--brdf ggx:0.6:1"), picture("--brdf ggx:0.6:1 --two-sided off"));
    EXPECT_NE(picture("--brdf ggx:0.6:1 --shadows traced --rays 64"),
              picture("--brdf ggx:0.6:1 --shadows traced --rays 64 --two-sided off"));
}

TEST_F(Program, RolesOfMeshes) {
    const auto picture = [&](const std::string& arguments) {
        const Outcome result = run("render boxes.gltf --size 64x48 --rays 256 --out picture " + arguments);
        EXPECT_EQ(result.code, 0) << arguments << "\n" << result.err;
        return contents(folder / "picture" / "frame_0000.png");
    };
    const std::string plain = picture("");
    EXPECT_NE(plain, picture("--ground"));
    EXPECT_NE(picture("--ground"), picture("--ground --shadows off"));
    EXPECT_NE(picture("--ground --shadows traced"), picture("--ground --shadows off"));
    // The ground takes part in materials and in direct light.
    for (const std::string how :
         {"--brdf ggx:0.6:0.5", "--light direct", "--brdf phong:5:0.3 --light direct"}) {
        EXPECT_NE(picture(how + " --ground"), picture(how)) << how;
        EXPECT_NE(picture(how + " --ground"), picture("--ground")) << how;
        EXPECT_NE(picture(how + " --ground"), picture(how + " --ground --receive-only 0 --receive-only 1"))
            << how;
    }
    // The upper one hides nothing any more; or it still does, but is not drawn.
    EXPECT_NE(plain, picture("--receive-only upper"));
    EXPECT_EQ(picture("--receive-only 1"), picture("--receive-only upper"));
    EXPECT_NE(plain, picture("--block-only upper"));
    // A square hides nothing of itself.
    EXPECT_EQ(picture("--block-only upper"), picture("--block-only upper --receive-only lower"));
    EXPECT_EQ(picture("--block-only upper --shadows off"), picture("--block-only 1 --shadows off"));
    EXPECT_NE(picture("--ground --block-only lower --block-only upper"),
              picture("--ground --receive-only lower "
                      "--block-only upper"));
    expect_failure(2, "render boxes.gltf --out out --receive-only roof", {"roof", "0 lower, 1 upper"});
    expect_failure(2, "render boxes.gltf --out out --block-only 2", {"--block-only", "upper"});
    expect_failure(2, "render twins.gltf --out out --receive-only lower", {"--receive-only", "number: 0, 1"});
    EXPECT_EQ(run("render twins.gltf --size 64x48 --out picture --receive-only 1").code, 0);
    expect_failure(2, "render boxes.gltf --out out --block-only 0 --block-only 1", {"--ground"});
    expect_failure(2, "render boxes.gltf --out out --block-only 0 --receive-only lower", {"one of the two"});
    expect_failure(2, "render slide.gltf --out out --ground --pvs slide.pvs", {"--ground"});
}

// The ground below a box that stands still is computed once.
TEST_F(Program, WhatStandsStillIsKept) {
    const std::string frames = "render boxes.gltf --size 64x48 --frames 1 --ground --out ";
    ASSERT_EQ(run(frames + "anew").code, 0);
    const Outcome kept = run(frames + "kept --keep");
    ASSERT_EQ(kept.code, 0) << kept.err;
    EXPECT_NE(kept.out.find("kept: 0.0 %"), std::string::npos) << kept.out;
    EXPECT_EQ(contents(folder / "anew" / "frame_0000.png"), contents(folder / "kept" / "frame_0000.png"));
    const std::string clip = "render slide.gltf --size 64x48 --frames 3 --fps 3 --ground --out ";
    ASSERT_EQ(run(clip + "anew").code, 0);
    const Outcome moving = run(clip + "kept --keep");
    ASSERT_EQ(moving.code, 0) << moving.err;
    // The whole ground sees the triangle move; below one that hides nothing it is computed once.
    const auto kept_share = [](const Outcome& done) {
        const size_t at = done.out.find("\nkept: ");
        return at == std::string::npos ? -1.0 : std::stod(done.out.substr(at + 7));
    };
    EXPECT_GE(kept_share(moving), 0) << moving.out;
    for (const char* name : {"frame_0000.png", "frame_0001.png", "frame_0002.png"})
        EXPECT_EQ(contents(folder / "anew" / name), contents(folder / "kept" / name)) << name;
    ASSERT_EQ(run(clip + "anew --receive-only 0").code, 0);
    const Outcome ghost = run(clip + "kept --receive-only 0 --keep");
    EXPECT_GT(kept_share(ghost), 30) << ghost.out << ghost.err;
    for (const char* name : {"frame_0000.png", "frame_0001.png", "frame_0002.png"})
        EXPECT_EQ(contents(folder / "anew" / name), contents(folder / "kept" / name)) << name;
    ASSERT_EQ(run(clip + "anew --receive-only 0 --watertight").code, 0);
    const Outcome tight = run(clip + "kept --receive-only 0 --watertight --keep");
    EXPECT_GT(kept_share(tight), 30) << tight.out << tight.err;
    for (const char* name : {"frame_0000.png", "frame_0001.png", "frame_0002.png"})
        EXPECT_EQ(contents(folder / "anew" / name), contents(folder / "kept" / name)) << name;
    for (const char* other : {"--shadows off", "--brdf ggx:0.4:1", "--light direct", "--falloff 0.1:1"})
        expect_failure(2, std::string("render slide.gltf --out out --keep ") + other, {"--keep"});
}

TEST_F(Program, RendersSeveralModels) {
    const std::string small = "render box.obj --size 64x48 --out ";
    const auto picture = [&](const std::string& options) {
        const Outcome result = run(small + "pictures " + options);
        EXPECT_EQ(result.code, 0) << result.err;
        EXPECT_EQ(result.err, "");
        return contents(folder / "pictures" / "frame_0000.png");
    };
    const std::string alone = picture(""), pair = picture("--with box.obj"),
                      apart = picture("--with box.obj --at 40:0:0");
    EXPECT_NE(pair, alone);
    EXPECT_NE(pair, apart);
    EXPECT_NE(picture("--with box.obj --at -40:0:0"), apart);
    EXPECT_NE(picture("--with box.obj --with slide.gltf --ground"), pair);
    // The second one's lid lies over a corner of the first one's, which has no other shadow.
    EXPECT_NE(picture("--with box.obj --at 2:0:1 --shadows off"), picture("--with box.obj --at 2:0:1"));
    ASSERT_EQ(run("render slide.gltf --with box.obj --size 64x48 --frames 2 --out pictures").code, 0);
    EXPECT_TRUE(contents(folder / "pictures" / "frame_0001.png").starts_with("\x89PNG"));
    EXPECT_NE(run("render --help").out.find("--with MODEL"), std::string::npos);
    EXPECT_NE(run("render --help").out.find("--at X:Y:Z"), std::string::npos);
    expect_failure(1, small + "out --with missing.obj", {"missing.obj"});
    expect_failure(2, small + "out --at 1:2:3", {"--at", "1 places for 0 models"});
    expect_failure(2, small + "out --with box.obj --at 1:2", {"--at", "'1:2' is no place"});
    expect_failure(2, small + "out --with box.obj --at 1:2:nan", {"--at", "'1:2:nan' is no place"});
    expect_failure(2, small + "out --with box.obj --at 1:2:1e9", {"--at", "1e6"});
    expect_failure(2, small + "out --with box.obj --at 1:2:3x", {"--at", "X:Y:Z"});
    expect_failure(2, small + "out --with box.obj --keep", {"--keep", "--with"});
    expect_failure(2, small + "out --with box.obj --pvs a.pvs", {"--pvs", "--with"});
}

TEST_F(Program, Study) {
    expect_failure(2, "study weather --out out", {"weather", "glossy"});
    expect_failure(2, "study glossy --scene moon --out out", {"moon", "hand"});
    const std::pair<const char*, size_t> topics[] = {{"glossy", 9},  {"direct", 12}, {"pvs", 3},
                                                     {"falloff", 6}, {"static", 4},  {"sides", 3},
                                                     {"outputs", 11}};
    for (const auto& [topic, rows] : topics) {
        const Outcome result = run(std::string("study ") + topic + " --quick --model box.obj --out out");
        ASSERT_EQ(result.code, 0) << result.err;
        const auto report = nlohmann::json::parse(contents(folder / "out" / (std::string(topic) + ".json")));
        EXPECT_EQ(report["topic"], topic);
        EXPECT_GE(report["rows"].size(), rows) << topic;
        EXPECT_EQ(result.out, contents(folder / "out" / (std::string(topic) + ".txt")));
        if (topic == std::string("static")) {
            EXPECT_NE(report["rows"][0]["receivers computed"], "0");
            EXPECT_EQ(report["rows"][3]["receivers computed"], "0"); // nothing moves
        }
        if (topic == std::string("direct")) {
            EXPECT_TRUE(contents(folder / "out" / "direct.png").starts_with("\x89PNG"));
        }
    }
}

TEST_F(Program, StudyOfManyObjects) {
    const Outcome result = run("study objects --quick --model box.obj --out out");
    ASSERT_EQ(result.code, 0) << result.err;
    const auto rows = nlohmann::json::parse(contents(folder / "out" / "objects.json"))["rows"];
    ASSERT_EQ(rows.size(), 4u);
    EXPECT_EQ(rows[2]["objects"], "16");
    for (const char* name : {"objects.png", "as_one.png", "alone.png"})
        EXPECT_TRUE(contents(folder / "out" / name).starts_with("\x89PNG")) << name;
}

TEST_F(Program, VisibleSetsOfAClip) {
    expect_failure(1, "pvs box.obj --out out", {"box.obj", "animation"});
    expect_failure(2, "pvs slide.gltf --out out --clip jump", {"jump"});
    expect_failure(2, "pvs slide.gltf --out out --segments 0", {"--segments"});
    expect_failure(2, "pvs slide.gltf --out out --segments 5000", {"--segments"});
    expect_failure(2, "pvs slide.gltf --out out --quality paper", {"paper"});
    expect_failure(1, "pvs slide.gltf --out missing/slide.pvs --frames 2", {"missing/slide.pvs"});
    const Outcome made = run("pvs slide.gltf --out slide.pvs --frames 5 --segments 2");
    ASSERT_EQ(made.code, 0) << made.err;
    EXPECT_NE(made.out.find("masks of 6 of 6 frames"), std::string::npos) << made.out;

    ASSERT_EQ(run("transfer slide.gltf --out plain --time 0.5").code, 0);
    ASSERT_EQ(run("transfer slide.gltf --out with --time 0.5 --pvs slide.pvs").code, 0);
    for (const char* name : {"masks.npy", "transfer.npy"})
        EXPECT_EQ(contents(folder / "plain" / name), contents(folder / "with" / name));
    expect_failure(1, "transfer box.obj --out out --pvs slide.pvs", {"slide.pvs", "other meshes"});
    const std::string picture = "render slide.gltf --size 64x48 --frames 2 --fps 2 --out ";
    ASSERT_EQ(run(picture + "seen").code, 0);
    ASSERT_EQ(run(picture + "seen_with --pvs slide.pvs").code, 0);
    for (const char* name : {"frame_0000.png", "frame_0001.png"})
        EXPECT_EQ(contents(folder / "seen" / name), contents(folder / "seen_with" / name));
    expect_failure(1, "render box.obj --size 64x48 --out out --pvs slide.pvs", {"slide.pvs", "other meshes"});
    expect_failure(2, picture + "out --pvs slide.pvs --shadows traced", {"--pvs", "--shadows"});
    expect_failure(1, "transfer slide.gltf --out out --pvs slide.pvs --quality fine", {"another quality"});
    expect_failure(1, "transfer slide.gltf --out out --pvs box.obj",
                   {"box.obj", "no potentially visible set"});
    expect_failure(1, "transfer slide.gltf --out out --pvs missing.pvs", {"missing.pvs"});
    const Outcome heat = run(picture + "heat --show visible-set --pvs slide.pvs");
    ASSERT_EQ(heat.code, 0) << heat.err;
    EXPECT_NE(heat.out.find("of the clusters are looked at"), std::string::npos) << heat.out;
    expect_failure(2, picture + "out --show visible-set", {"--pvs"});
    // One scale for all segments: a moment of the first, which sees less, has that of the clip.
    ASSERT_EQ(run("pvs visit.gltf --out visit.pvs --frames 5 --segments 2").code, 0);
    const std::string visit = "render visit.gltf --size 64x48 --show visible-set --pvs visit.pvs --out ";
    for (const char* frames : {"clip --frames 3 --fps 2", "first --time 0", "last --time 1"}) {
        const Outcome seen = run(visit + frames);
        ASSERT_EQ(seen.code, 0) << seen.err;
        EXPECT_NE(seen.out.find("orange: 66.7 %"), std::string::npos) << seen.out;
    }
    // A leaf's backs are recorded too, unless told otherwise.
    ASSERT_NE(run("pvs leaf.gltf --out leaf.pvs --frames 2").out.find("both sides"), std::string::npos);
    const std::string leaf = "render leaf.gltf --size 64x48 --time 0.5 --out ";
    ASSERT_EQ(run(leaf + "leaf").code, 0);
    ASSERT_EQ(run(leaf + "leaf_with --pvs leaf.pvs").code, 0);
    EXPECT_EQ(contents(folder / "leaf" / "frame_0000.png"),
              contents(folder / "leaf_with" / "frame_0000.png"));
    ASSERT_EQ(run(leaf + "one_side --pvs leaf.pvs --two-sided off").code, 0);
    ASSERT_EQ(run("transfer leaf.gltf --out both --time 0.5 --two-sided model --pvs leaf.pvs").code, 0);
    expect_failure(1, leaf + "out --pvs leaf.pvs --watertight", {"leaf.gltf", "--watertight"});
    ASSERT_EQ(run("pvs leaf.gltf --out front.pvs --frames 2 --two-sided off").code, 0);
    expect_failure(1, leaf + "out --pvs front.pvs", {"leaf.gltf", "--two-sided off"});
    // All sides of a model that names none.
    ASSERT_EQ(run("pvs slide.gltf --out front.pvs --frames 2").code, 0);
    const std::string all = "transfer slide.gltf --time 0.5 --two-sided all --out ";
    expect_failure(1, all + "out --pvs front.pvs", {"slide.gltf", "--two-sided off"});
    ASSERT_NE(run("pvs slide.gltf --out all.pvs --frames 2 --two-sided all").out.find("both sides"),
              std::string::npos);
    ASSERT_EQ(run(all + "plain").code, 0);
    ASSERT_EQ(run(all + "listed --pvs all.pvs").code, 0);
    for (const char* name : {"transfer.npy", "transfer_back.npy"})
        EXPECT_EQ(contents(folder / "plain" / name), contents(folder / "listed" / name)) << name;
    ASSERT_EQ(run("pvs leaf.gltf --out tight.pvs --frames 2 --watertight").code, 0);
    ASSERT_EQ(run(leaf + "tight --pvs tight.pvs --watertight").code, 0);
    const std::string whole = contents(folder / "slide.pvs");
    std::ofstream(folder / "cut.pvs", std::ios::binary) << whole.substr(0, whole.size() / 2);
    expect_failure(1, "transfer slide.gltf --out out --pvs cut.pvs", {"cut.pvs", "cut short"});
}

TEST_F(Program, Info) {
    const Outcome text = run("info slide.gltf");
    EXPECT_EQ(text.code, 0);
    EXPECT_NE(text.out.find("slide"), std::string::npos);
    EXPECT_NE(text.out.find("open"), std::string::npos);
    const Outcome json = run("info box.obj --json");
    const auto report = nlohmann::json::parse(json.out);
    EXPECT_EQ(report["triangles"], 14);
    EXPECT_EQ(report["meshes"][0]["closed_components"], 1);
    EXPECT_EQ(report["meshes"][0]["components"], 2);
    EXPECT_EQ(report["clips"].size(), 0u);
}

TEST_F(Program, OutputThatIsThereIsReplacedWhole) {
    ASSERT_EQ(run("transfer box.obj --out out").code, 0);
    const std::string first = contents(folder / "out" / "transfer.npy");
    std::ofstream(folder / "out" / "mine.txt") << "mine";
    ASSERT_EQ(run("transfer slide.gltf --out out").code, 0);
    EXPECT_NE(contents(folder / "out" / "transfer.npy"), first);
    EXPECT_EQ(contents(folder / "out" / "mine.txt"), "mine");
    EXPECT_EQ(std::distance(fs::directory_iterator(folder / "out"), {}), 7);
}

// What stands where results should go is left alone, and nobody waits for a FIFO's reader or writer.
TEST_F(Program, OutputsInTheWay) {
    std::ofstream(folder / "file") << "mine";
    fs::create_symlink("nowhere", folder / "dangling");
    fs::create_directory(folder / "real");
    fs::create_symlink("real", folder / "link");
    ASSERT_EQ(mkfifo((folder / "fifo").c_str(), 0600), 0);
    for (const std::string name : {"file", "fifo", "file/below", "dangling"})
        expect_failure(1, "transfer box.obj --out " + name, {name, "--out"});
    EXPECT_EQ(contents(folder / "file"), "mine");
    EXPECT_TRUE(fs::is_fifo(folder / "fifo"));
    EXPECT_TRUE(fs::is_symlink(folder / "dangling"));
    EXPECT_FALSE(fs::exists(folder / "nowhere"));
    ASSERT_EQ(run("transfer box.obj --out link").code, 0);
    EXPECT_TRUE(fs::is_symlink(folder / "link"));
    EXPECT_TRUE(fs::exists(folder / "real" / "transfer.npy"));
    expect_failure(1, "pvs slide.gltf --out real", {"real"}); // one file
    EXPECT_TRUE(fs::exists(folder / "real" / "transfer.npy"));
}

// Nobody reads what it says: that is a failure, told, and no signal ends it.
TEST_F(Program, ClosedStandardOutput) {
    for (const std::string arguments : {"info box.obj", "info box.obj --json", "--help"}) {
        const std::string command = "cd '" + folder.string() + "' && ( sleep 0.2; '" NUSSELT_PROGRAM "' " +
                                    arguments + " 2>stderr; echo $? >code ) | :";
        ASSERT_NE(std::system(command.c_str()), -1);
        EXPECT_EQ(contents(folder / "code"), "1\n") << arguments;
        EXPECT_TRUE(contents(folder / "stderr").starts_with("nusselt: ")) << arguments;
    }
}

TEST_F(Program, Demo) {
    const Outcome result = run("demo --quick --out out/demo");
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(result.err, "");
    EXPECT_TRUE(result.out.ends_with("\nout/demo/index.html\n")) << result.out;
    const std::string page = contents(folder / "out" / "demo" / "index.html");
    // Self-contained: nothing is fetched.
    EXPECT_EQ(page.find("http"), std::string::npos);
    EXPECT_EQ(page.find("src=\""), std::string::npos);
    const auto table = nlohmann::json::parse(contents(folder / "out" / "demo" / "table.json"));
    ASSERT_EQ(table["scenes"].size(), 4u);
    for (const auto& scene : table["scenes"]) {
        const std::string name = scene["name"];
        EXPECT_NE(result.out.find(name), std::string::npos);
        EXPECT_NEAR(scene["vertices"].get<double>() / scene["paper"]["vertices"].get<double>(), 1, 0.05)
            << name;
        EXPECT_NEAR(scene["triangles"].get<double>() / scene["paper"]["triangles"].get<double>(), 1, 0.05)
            << name;
        // Loose: small pictures, few rays. The benchmark has the figures.
        EXPECT_LT(scene["clear_mean"], 0.08) << name;
        EXPECT_TRUE(fs::exists(folder / "out" / "demo" / "frames" / (name + "_01.png")));
    }
    const auto& crowd = table["crowd"];
    EXPECT_GE(crowd["objects"], 16);
    EXPECT_LT(crowd["clear_mean"].get<double>(), 0.6 * crowd["alone_clear_mean"].get<double>());
    EXPECT_EQ(crowd["growth"].size(), 5u);
    EXPECT_TRUE(fs::exists(folder / "out" / "demo" / "frames" / "crowd.png"));
    EXPECT_NE(page.find("<svg"), std::string::npos);
}

} // namespace
} // namespace nusselt::tools
