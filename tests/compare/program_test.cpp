// `nusselt compare` as CI runs it.
#include "schema.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <sys/wait.h>
#include <unistd.h>

namespace nusselt::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::string read(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

struct Folder {
    fs::path path;
    Folder() {
        std::string name = (fs::temp_directory_path() / "nusselt-compare-XXXXXX").string();
        path = mkdtemp(name.data());
    }
    ~Folder() {
        std::error_code ignored;
        fs::remove_all(path, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;

    // A slab over a plane: shadows, contact, open sky; 289 + 8 vertices.
    std::string model() const {
        std::ofstream file(path / "small.obj");
        constexpr int side = 17;
        for (int y = 0; y < side; ++y)
            for (int x = 0; x < side; ++x)
                file << "v " << x - 8 << " " << 0.02 * ((x * x + y) % 5) << " " << y - 8 << "\n";
        for (int y = 0; y + 1 < side; ++y)
            for (int x = 0; x + 1 < side; ++x) {
                const int a = y * side + x + 1;
                file << "f " << a << " " << a + side << " " << a + side + 1 << "\nf " << a << " "
                     << a + side + 1 << " " << a + 1 << "\n";
            }
        for (int k = 0; k < 8; ++k)
            file << "v " << (k & 1 ? 3 : -3) << " " << (k & 2 ? 2.5 : 2) << " " << (k & 4 ? 3 : -3) << "\n";
        const int faces[6][4] = {{1, 3, 4, 2}, {5, 6, 8, 7}, {1, 2, 6, 5},
                                 {3, 7, 8, 4}, {1, 5, 7, 3}, {2, 4, 8, 6}};
        for (const auto& f : faces)
            file << "f " << f[0] + 289 << " " << f[1] + 289 << " " << f[2] + 289 << " " << f[3] + 289 << "\n";
        return (path / "small.obj").string();
    }
};

int run(const std::string& arguments, const fs::path& log) {
    const int status =
        std::system((std::string(NUSSELT_PROGRAM) + " " + arguments + " >" + log.string() + " 2>&1").c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

// Opens the page in a browser, does `first` there, and looks whether every plot has drawn itself without a
// word on the console. Without a browser the rest of the test is left out, and says so.
void expect_page_draws(const std::string& page, int plots, const fs::path& folder,
                       const std::string& first = "") {
    const std::string browser = [] {
        for (const char* name : {"chromium", "chromium-browser", "google-chrome"})
            if (std::system(("command -v " + std::string(name) + " >/dev/null 2>&1").c_str()) == 0)
                return name;
        return "";
    }();
    if (browser.empty()) GTEST_SKIP() << "no chromium: the page was not opened";
    // The page reports through its title what a test must know.
    const fs::path dom = folder / "dom.html";
    std::string probe = page;
    probe.insert(
        probe.find("<script>"),
        "<script>window.problems = []; window.onerror = text => { window.problems.push(text); };"
        "console.error = console.warn = (...parts) => { window.problems.push(parts.join(' ')); };</script>");
    probe.insert(probe.rfind("</body>"),
                 "<script>" + first +
                     "setTimeout(() => { document.title = 'drawn ' + plots.drawn + ' of ' + plots.expected + "
                     "', problems ' + problems.length + ' ' + problems.join('; '); }, 2000);</script>");
    std::ofstream(folder / "probe.html", std::ios::binary) << probe;
    const std::string command =
        "timeout 60 " + browser +
        " --headless --no-sandbox --disable-gpu --user-data-dir=" + (folder / "profile").string() +
        " --virtual-time-budget=8000 --dump-dom file://" + (folder / "probe.html").string() + " >" +
        dom.string() + " 2>/dev/null";
    ASSERT_EQ(std::system(command.c_str()), 0);
    const std::string text = read(dom);
    const size_t title = text.find("<title>");
    ASSERT_NE(title, std::string::npos);
    const std::string number = std::to_string(plots);
    EXPECT_EQ(text.substr(title + 7, text.find("</title>") - title - 7),
              "drawn " + number + " of " + number + ", problems 0 ");
}

TEST(Schema, TellsWhatIsWrong) {
    const json schema = json::parse(R"({"type": "object", "required": ["a"], "additionalProperties": false,
        "properties": {"a": {"type": "number", "minimum": 0}, "b": {"type": "array", "items": {"enum": ["x"]}}}})");
    EXPECT_TRUE(violations(schema, json::parse(R"({"a": 1, "b": ["x"]})")).empty());
    EXPECT_EQ(violations(schema, json::parse(R"({"a": -1, "b": ["y"], "c": 0})")).size(), 3u);
    EXPECT_EQ(violations(schema, json::parse("{}")).size(), 1u);
}

TEST(Compare, QuickOnASmallModel) {
    const Folder folder;
    const std::string model = folder.model();
    const fs::path readme = folder.path / "README.md", out = folder.path / "out";
    std::ofstream(readme) << "before\n<!-- compare:begin -->\n<!-- compare:end -->\nafter\n";
    ASSERT_EQ(run("compare " + model + " --quick --naive --study direct glossy --out " + out.string() +
                      " --readme " + readme.string(),
                  folder.path / "log"),
              0)
        << read(folder.path / "log");

    const json report = json::parse(read(out / "report.json"));
    for (const std::string& violation : violations(json::parse(read(NUSSELT_SCHEMA)), report))
        ADD_FAILURE() << violation;
    ASSERT_EQ(report["scenes"].size(), 1u);
    const json& scene = report["scenes"][0];
    std::set<std::string> names;
    double paper_error = 0, fine_error = 1;
    for (const json& entry : scene["entries"]) {
        names.insert(entry["name"]);
        if (entry["kind"] == "floor") continue;
        EXPECT_GT(entry["us_per_vertex"]["min"].get<double>(), 0) << entry["name"];
        EXPECT_LE(entry["us_per_vertex"]["min"].get<double>(),
                  entry["us_per_vertex"]["median"].get<double>());
        if (entry["name"] == "paper") paper_error = entry["error"]["clear"]["mean"];
        if (entry["name"] == "fine") fine_error = entry["error"]["clear"]["mean"];
    }
    for (const char* name :
         {"paper", "draft", "standard", "fine", "embree 16", "embree 1024", "naive 1024", "floor 1024"})
        EXPECT_TRUE(names.count(name)) << name;
    EXPECT_LT(fine_error, paper_error);
    EXPECT_LT(scene["reference"]["noise"]["clear"]["mean"].get<double>(), 0.01);
    // One result for all numbers of threads.
    std::map<std::string, std::set<std::string>> hashes;
    for (const json& point : scene["scaling"])
        hashes[point["entry"]].insert(point["hash"].get<std::string>());
    for (const auto& [entry, different] : hashes)
        EXPECT_EQ(different.size(), 1u) << entry;

    ASSERT_EQ(report["studies"].size(), 2u);
    std::map<std::string, double> under_a_sun;
    for (const json& row : report["studies"][0]["rows"])
        if (row[0] == "a sun of 1 degree alone") under_a_sun[row[1]] = std::stod(row[3].get<std::string>());
    EXPECT_EQ(under_a_sun.size(), 3u);
    EXPECT_GT(under_a_sun.at("direct"), 0);
    EXPECT_LT(under_a_sun.at("direct"), 50);
    EXPECT_EQ(report["studies"][1]["topic"], "glossy");
    EXPECT_NE(read(out / "index.html").find("metal, roughness 0.4"), std::string::npos);
    EXPECT_NE(read(out / "tables.md").find("| metal, roughness 0.4 |"), std::string::npos);
    EXPECT_EQ(read(readme).find("| metal, roughness 0.4 |"), std::string::npos); // one screen

    EXPECT_NE(read(readme).find("| standard |"), std::string::npos);
    EXPECT_TRUE(read(readme).starts_with("before\n") && read(readme).ends_with("\nafter\n"));
    EXPECT_NE(read(folder.path / "log").find("standard"), std::string::npos);

    const std::string page = read(out / "index.html");
    EXPECT_NE(page.find("Chart.js"), std::string::npos);
    EXPECT_EQ(page.find("http-equiv"), std::string::npos);
    EXPECT_EQ(page.find("src=\"http"), std::string::npos);
    expect_page_draws(page, 6, folder.path);
}

TEST(Compare, SeveralModelsEachWithinALimit) {
    const Folder folder;
    fs::create_directories(folder.path / "models" / "below");
    fs::copy(folder.model(), folder.path / "models" / "a.obj");
    for (int k = 0; k < 7; ++k)
        fs::copy(folder.path / "small.obj",
                 folder.path / "models" / "below" / ("b" + std::to_string(k) + ".OBJ"));
    fs::copy(folder.path / "small.obj", folder.path / "models" / "below" / "a.obj");
    std::ofstream(folder.path / "models" / "broken.ply") << "ply\n";
    std::ofstream(folder.path / "models" / "notes.txt") << "no model\n";
    const fs::path out = folder.path / "out";
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_EQ(run("compare " + (folder.path / "models").string() + " --quick --limit 2 --out " + out.string(),
                  folder.path / "log"),
              1);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    EXPECT_LT(seconds, 9 * 2 * 3) << "three times the limit, on a busy machine";
    const std::string log = read(folder.path / "log");
    EXPECT_NE(log.find("broken.ply: not measured"), std::string::npos) << log;
    EXPECT_NE(log.find("1 of 10 models could not be measured"), std::string::npos) << log;
    const json report = json::parse(read(out / "report.json"));
    for (const std::string& violation : violations(json::parse(read(NUSSELT_SCHEMA)), report))
        ADD_FAILURE() << violation;
    std::set<std::string> names;
    for (const json& scene : report["scenes"])
        names.insert(scene["name"]);
    EXPECT_EQ(names.size(), 9u) << log;
    EXPECT_TRUE(names.count("a.obj") && names.count("below/a.obj") && names.count("b6.OBJ")) << log;
    ASSERT_EQ(report["failures"].size(), 1u);
    EXPECT_EQ(report["failures"][0]["name"], "broken.ply");
    // Folded until they are asked for: the two plots of sizes alone.
    expect_page_draws(read(out / "index.html"), 2, folder.path);
    expect_page_draws(read(out / "index.html"), 2 + 9 * 3, folder.path,
                      "for (const card of document.querySelectorAll('details')) card.open = true;");
}

TEST(Compare, CutShortTellsWhatIsDone) {
    const Folder folder;
    const std::string model = folder.model(), out = (folder.path / "out").string();
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
        std::freopen((folder.path / "log").c_str(), "w", stdout);
        execl(NUSSELT_PROGRAM, "nusselt", "compare", model.c_str(), "--repeats", "10000", "--out",
              out.c_str(), nullptr);
        _exit(127);
    }
    sleep(8);
    kill(child, SIGINT);
    int status = 0;
    waitpid(child, &status, 0);
    ASSERT_TRUE(WIFEXITED(status));
    if (WEXITSTATUS(status) != 0) GTEST_SKIP() << "too slow: cut short before the first reference was there";
    const json report = json::parse(read(fs::path(out) / "report.json"));
    EXPECT_FALSE(report["complete"].get<bool>());
    for (const std::string& violation : violations(json::parse(read(NUSSELT_SCHEMA)), report))
        ADD_FAILURE() << violation;
}

TEST(Compare, UsageIsChecked) {
    const Folder folder;
    const std::string out = " --out " + (folder.path / "out").string(), model = folder.model();
    EXPECT_EQ(run("compare --scene nowhere" + out, folder.path / "log"), 2);
    EXPECT_NE(read(folder.path / "log").find("cloth"), std::string::npos);
    EXPECT_EQ(run("compare " + model + " --frames 0" + out, folder.path / "log"), 2);
    EXPECT_EQ(run("compare " + model + " --limit -1" + out, folder.path / "log"), 2);
    EXPECT_EQ(run("compare " + model + " " + model + " --clip 0" + out, folder.path / "log"), 2);
    EXPECT_EQ(run("compare " + (folder.path / "nowhere.glb").string() + out, folder.path / "log"), 1);
    fs::create_directory(folder.path / "empty");
    EXPECT_EQ(run("compare " + (folder.path / "empty").string() + out, folder.path / "log"), 1);
    EXPECT_NE(read(folder.path / "log").find("holds no .gltf"), std::string::npos);
    std::ofstream(folder.path / "plain.md") << "no markers\n";
    EXPECT_EQ(run("compare " + model + " --readme " + (folder.path / "plain.md").string() + out,
                  folder.path / "log"),
              1);
    EXPECT_FALSE(fs::exists(folder.path / "out"));
}

} // namespace
} // namespace nusselt::test
