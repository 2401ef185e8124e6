#include "tools/report/failure.h"
#include "tools/report/npy.h"
#include "tools/report/output.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <unistd.h>

namespace nusselt::tools {
namespace {

namespace fs = std::filesystem;

struct Folder {
    fs::path path;
    Folder() {
        std::string name = (fs::temp_directory_path() / "nusselt-report-XXXXXX").string();
        path = mkdtemp(name.data());
    }
    ~Folder() {
        std::error_code ignored;
        fs::permissions(path, fs::perms::owner_all, ignored);
        fs::remove_all(path, ignored);
    }
};

std::string contents(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

size_t entries(const fs::path& path) {
    return static_cast<size_t>(std::distance(fs::directory_iterator(path), {}));
}

TEST(Npy, HeaderAsNumPyWritesIt) {
    const float data[6] = {0, 1, 2, 3, 4, 5};
    const std::string bytes = npy(data, {2, 3});
    ASSERT_EQ(bytes.size(), 128u + 24u);
    EXPECT_EQ(bytes.substr(0, 10), std::string("\x93NUMPY\x01\x00\x76\x00", 10));
    EXPECT_EQ(bytes.substr(10, 60), "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), } ");
    EXPECT_EQ(bytes[127], '\n');
    EXPECT_EQ(std::memcmp(bytes.data() + 128, data, 24), 0);
}

TEST(Npy, OneDimensionAndNone) {
    const uint32_t data[2] = {7, 8};
    EXPECT_NE(npy(data, {2}).find("'<u4', 'fortran_order': False, 'shape': (2,), }"), std::string::npos);
    const std::string empty = npy(static_cast<const uint32_t*>(nullptr), {0, 3});
    EXPECT_NE(empty.find("(0, 3), }"), std::string::npos);
    EXPECT_EQ(empty.size() % 64, 0u);
}

TEST(OutputDirectory, AppearsWhole) {
    const Folder folder;
    const fs::path out = folder.path / "a" / "b" / "out";
    {
        OutputDirectory directory(out.string() + "/");
        directory.add("one.txt", "1");
        directory.add("sub/two.txt", "2");
        EXPECT_FALSE(fs::exists(out));
        directory.commit();
    }
    EXPECT_EQ(contents(out / "one.txt"), "1");
    EXPECT_EQ(contents(out / "sub" / "two.txt"), "2");
    EXPECT_EQ(entries(folder.path / "a" / "b"), 1u);
}

TEST(OutputDirectory, LeavesNothingWithoutCommit) {
    const Folder folder;
    {
        OutputDirectory directory((folder.path / "a" / "out").string());
        directory.add("one.txt", "1");
    }
    EXPECT_EQ(entries(folder.path), 0u);

    fs::create_directory(folder.path / "there");
    std::ofstream(folder.path / "there" / "one.txt") << "old";
    {
        OutputDirectory directory((folder.path / "there").string());
        directory.add("one.txt", "new");
    }
    EXPECT_EQ(entries(folder.path / "there"), 1u);
    EXPECT_EQ(contents(folder.path / "there" / "one.txt"), "old");
}

TEST(OutputDirectory, ReplacesItsOwnAndKeepsTheRest) {
    const Folder folder;
    std::ofstream(folder.path / "mine.txt") << "mine";
    std::ofstream(folder.path / "one.txt") << "old";
    OutputDirectory directory(folder.path.string());
    directory.add("one.txt", "new");
    directory.add("sub/two.txt", "2");
    directory.commit();
    EXPECT_EQ(contents(folder.path / "mine.txt"), "mine");
    EXPECT_EQ(contents(folder.path / "one.txt"), "new");
    EXPECT_EQ(contents(folder.path / "sub" / "two.txt"), "2");
}

TEST(OutputDirectory, SaysWhatIsInTheWay) {
    const Folder folder;
    std::ofstream(folder.path / "file") << "x";
    EXPECT_THROW(OutputDirectory((folder.path / "file").string()), Failure);
    EXPECT_THROW(OutputDirectory((folder.path / "file" / "out").string()), Failure);
    EXPECT_THROW(OutputDirectory("/proc/no/such/place"), Failure);

    fs::create_directory(folder.path / "one.txt");
    OutputDirectory directory(folder.path.string());
    directory.add("first.txt", "1");
    directory.add("one.txt", "2");
    EXPECT_THROW(directory.commit(), Failure);
    EXPECT_FALSE(fs::exists(folder.path / "first.txt"));
}

TEST(OutputDirectory, UnwritableIsSaidBeforeTheWork) {
    if (geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
    const Folder folder;
    fs::permissions(folder.path, fs::perms::owner_read | fs::perms::owner_exec);
    EXPECT_THROW(OutputDirectory(folder.path.string()), Failure);
    EXPECT_THROW(OutputDirectory((folder.path / "out").string()), Failure);
}

TEST(WriteFile, ReplacesAndLeavesNoTemporary) {
    const Folder folder;
    const std::string path = (folder.path / "x").string();
    write_file(path, "1");
    write_file(path, "22");
    EXPECT_EQ(contents(path), "22");
    EXPECT_EQ(entries(folder.path), 1u);
    EXPECT_THROW(write_file((folder.path / "no" / "x").string(), "1"), Failure);
}

TEST(FailureLine, HoldsNoControlCharacters) {
    EXPECT_EQ(failure_line("a\x1b[31m\n", "b\r\x7f"), "nusselt: a?[31m?: b??");
    EXPECT_LT(failure_line(std::string(5000, 'a'), "b").size(), 500u);
}

} // namespace
} // namespace nusselt::tools
