#include "tools/image/image.h"
#include "tools/report/failure.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <gtest/gtest.h>
#include <nusselt/lighting.h>

#define STB_IMAGE_STATIC
#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#define STBI_ONLY_JPEG
#include <stb_image.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <string_view>

namespace nusselt::tools {
namespace {

namespace fs = std::filesystem;

std::string hdr(const std::string& header, const std::string& size, const std::string& pixels) {
    return "#?RADIANCE\n" + header + "FORMAT=32-bit_rle_rgbe\n\n" + size + "\n" + pixels;
}

// What read_hdr has against it; empty where it reads.
std::string complaint(const std::string& bytes) {
    try {
        (void)read_hdr(bytes, "x.hdr");
        return {};
    } catch (const Failure& failure) {
        EXPECT_EQ(failure.subject, "x.hdr");
        return failure.what();
    }
}

TEST(Hdr, FlatPixels) {
    const Image image =
        read_hdr(hdr("", "-Y 1 +X 2", std::string("\x80\x40\x20\x81\xFF\x00\x01\x00", 8)), "x");
    ASSERT_EQ(image.width, 2u);
    ASSERT_EQ(image.height, 1u);
    EXPECT_EQ(image.rgb, (std::vector<float>{1, 0.5f, 0.25f, 0, 0, 0}));
}

TEST(Hdr, RunsPlaneByPlane) {
    // 10 pixels: red a run, green bytes, blue a run and bytes, exponent a run.
    std::string row("\x02\x02\x00\x0A", 4);
    row += "\x8A\x80";
    row += std::string("\x0A\x00\x01\x02\x03\x04\x05\x06\x07\x08\x09", 11);
    row += std::string("\x88\x10\x02\x20\x30", 5);
    row += "\x8A\x81";
    const Image image = read_hdr(hdr("", "-Y 1 +X 10", row), "x");
    for (size_t x = 0; x < 10; ++x) {
        EXPECT_EQ(image.rgb[3 * x], 1.0f);
        EXPECT_EQ(image.rgb[3 * x + 1], static_cast<float>(x) / 128);
        EXPECT_EQ(image.rgb[3 * x + 2], (x < 8 ? 16.0f : x == 8 ? 32.0f : 48.0f) / 128);
    }
}

TEST(Hdr, ExposureDivides) {
    const std::string pixel("\x80\x80\x80\x81", 4);
    EXPECT_EQ(read_hdr(hdr("EXPOSURE=4\nEXPOSURE= 0.5\n", "-Y 1 +X 1", pixel), "x").rgb[0], 0.5f);
    EXPECT_NE(complaint(hdr("EXPOSURE=0\n", "-Y 1 +X 1", pixel)), "");
    EXPECT_NE(complaint(hdr("EXPOSURE=nan\n", "-Y 1 +X 1", pixel)), "");
    EXPECT_NE(complaint(hdr("EXPOSURE=bright\n", "-Y 1 +X 1", pixel)), "");
}

TEST(Hdr, SaysWhatItDoesNotRead) {
    const std::string pixel("\x80\x80\x80\x81", 4);
    EXPECT_NE(complaint("").find("ends early"), std::string::npos);
    EXPECT_NE(complaint("#?RADIANCE\nC=" + std::string(5000, 'a')).find("2048"), std::string::npos);
    EXPECT_NE(complaint("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n" + pixel).find("format"),
              std::string::npos);
    EXPECT_NE(complaint(hdr("GAMMA=2.2\n", "-Y 1 +X 1", pixel)).find("gamma"), std::string::npos);
    for (const char* size :
         {"+Y 1 +X 1", "-Y 1 -X 1", "+X 1 -Y 1", "-Y -1 +X 1", "-Y 1", "", "-Y 99999999999 +X 1"})
        EXPECT_NE(complaint(hdr("", size, pixel)).find("orientation"), std::string::npos) << size;
    EXPECT_NE(complaint(hdr("", "-Y 0 +X 0", "")).find("no pixels"), std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 8193 +X 1", pixel)).find("scale it down"), std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 8192 +X 16384", pixel)).find("scale it down"), std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 4000 +X 4000", pixel)).find("too few bytes"), std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 1 +X 2", pixel)).find("early"), std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 1 +X 2", pixel + std::string("\x01\x01\x01\x05", 4))).find("1991"),
              std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 1 +X 9", std::string("\x02\x02\x00\x0A\x8A\x80", 6))).find("width"),
              std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 1 +X 9", std::string("\x02\x02\x00\x09\x8A\x80", 6))).find("runs"),
              std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 1 +X 9", std::string("\x02\x02\x00\x09\x00\x80", 6))).find("runs"),
              std::string::npos);
    EXPECT_NE(complaint(hdr("", "-Y 1 +X 9", std::string("\x02\x02\x00\x09\x89", 5))).find("early"),
              std::string::npos);
}

TEST(Hdr, EveryTruncationIsSaid) {
    std::string row("\x02\x02\x00\x08", 4);
    for (int plane = 0; plane < 4; ++plane)
        row += "\x88\x81";
    const std::string whole = hdr("", "-Y 2 +X 8", row + row);
    EXPECT_EQ(complaint(whole), "");
    for (size_t size = 0; size < whole.size(); ++size)
        EXPECT_NE(complaint(whole.substr(0, size)), "") << size;
}

class Sink : public Imf::OStream {
public:
    Sink() : OStream("memory") {}
    std::string bytes;
    size_t at = 0;
    void write(const char data[], int count) override {
        bytes.resize(std::max(bytes.size(), at + static_cast<size_t>(count)));
        std::memcpy(bytes.data() + at, data, static_cast<size_t>(count));
        at += static_cast<size_t>(count);
    }
    uint64_t tellp() override { return at; }
    void seekp(uint64_t position) override { at = position; }
};

// 8 x 2 floats whose value is 10 x + y, in one data window within the display window.
std::string exr(const std::vector<std::string>& channels, int first_x = 0, bool latlong = false) {
    Sink sink;
    {
        Imf::Header header(Imath::Box2i({0, 0}, {7, 1}), Imath::Box2i({first_x, 0}, {7, 1}));
        header.compression() = Imf::ZIP_COMPRESSION;
        if (latlong) Imf::addEnvmap(header, Imf::ENVMAP_LATLONG);
        std::vector<float> data(16);
        for (size_t k = 0; k < 16; ++k)
            data[k] = static_cast<float>(10 * (k % 8) + k / 8);
        Imf::FrameBuffer frame;
        for (const std::string& channel : channels) {
            header.channels().insert(channel, Imf::Channel(Imf::FLOAT));
            frame.insert(channel, Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(data.data()), 4, 32));
        }
        Imf::OutputFile file(sink, header);
        file.setFrameBuffer(frame);
        file.writePixels(2);
    }
    return sink.bytes;
}

TEST(Exr, PixelsAndWindows) {
    const Image image = read_exr(exr({"R", "G", "B"}), "x");
    ASSERT_EQ(image.width, 8u);
    ASSERT_EQ(image.height, 2u);
    EXPECT_EQ(image.rgb[(8 + 3) * 3], 31.0f);
    const Image cropped = read_exr(exr({"R", "G", "B"}, 2), "x");
    ASSERT_EQ(cropped.width, 8u);
    EXPECT_EQ(cropped.rgb[(8 + 1) * 3], 0.0f);
    EXPECT_EQ(cropped.rgb[(8 + 2) * 3], 21.0f);
    EXPECT_EQ(read_exr(exr({"Y"}), "x").rgb[(8 + 3) * 3 + 2], 31.0f);
}

TEST(Exr, LatlongIsTurnedToOurAxes) {
    // OpenEXR: column 1/4 is +x. Ours: the middle.
    EXPECT_EQ(read_exr(exr({"R", "G", "B"}, 0, true), "x").rgb[4 * 3], 20.0f);
}

TEST(Exr, DamageIsSaid) {
    EXPECT_THROW((void)read_exr(exr({"Z"}), "x"), Failure);
    const std::string whole = exr({"R", "G", "B"});
    for (size_t size = 0; size < whole.size(); ++size)
        EXPECT_THROW((void)read_exr(whole.substr(0, size), "x"), Failure) << size;
    // One byte wrong anywhere: an image of the stated size, or a Failure.
    for (size_t at = 0; at < whole.size(); ++at) {
        for (const int value : {0x00, 0x7F, 0x80, 0xFF}) {
            std::string damaged = whole;
            damaged[at] = static_cast<char>(value);
            try {
                const Image image = read_exr(damaged, "x");
                EXPECT_EQ(image.rgb.size(), size_t{image.width} * image.height * 3);
            } catch (const Failure&) {
            }
        }
    }
}

TEST(Environment, RealFilesRead) {
    const fs::path folder = fs::path(NUSSELT_SHARED_DIR) / "data" / "env";
    if (!fs::is_directory(folder)) GTEST_SKIP() << "no real data at " << folder;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
        const Image image = load_environment(entry.path().string());
        EXPECT_EQ(image.width, 2 * image.height) << entry.path();
        double sum = 0;
        for (const float value : image.rgb) {
            ASSERT_TRUE(std::isfinite(value)) << entry.path();
            sum += value;
        }
        EXPECT_GT(sum, 0) << entry.path();
    }
}

// bad_images.tsv: each image of the shared data's broken files and what becomes of it, at once.
TEST(Environment, BadFilesFollowThePolicy) {
    const fs::path bad = fs::path(NUSSELT_SHARED_DIR) / "data" / "bad";
    if (!fs::is_directory(bad)) GTEST_SKIP() << "no real data at " << bad;
    std::map<std::string, std::string> policy;
    std::ifstream table(fs::path(NUSSELT_TOOLS_TESTS) / "bad_images.tsv");
    for (std::string line; std::getline(table, line);) {
        if (line.empty() || line[0] == '#') continue;
        const size_t tab = line.find('\t');
        ASSERT_NE(tab, std::string::npos) << line;
        policy[line.substr(0, tab)] = line.substr(tab + 1);
    }
    size_t files = 0;
    for (const char* folder : {"image", "handmade"}) {
        for (const fs::directory_entry& entry : fs::recursive_directory_iterator(bad / folder)) {
            const bool image_file = std::string_view(folder) == "image" || entry.path().extension() == ".hdr";
            if (!entry.is_regular_file() || !image_file) continue;
            ++files;
            const std::string name = fs::relative(entry.path(), bad).string();
            std::string outcome;
            const auto start = std::chrono::steady_clock::now();
            try {
                const Image image = load_environment(entry.path().string());
                EXPECT_EQ(image.rgb.size(), size_t{image.width} * image.height * 3) << name;
                float light[75];
                uint64_t told = 0;
                ASSERT_TRUE(
                    sh_project_latlong(image.rgb.data(), image.width, image.height, light, &told).ok());
                outcome = told > 0 ? "loads-with-warning" : "loads";
            } catch (const Failure& failure) {
                EXPECT_EQ(failure.exit_code, exit_failure);
                outcome = failure.what();
                for (const char c : failure_line(failure.subject, outcome))
                    EXPECT_GE(static_cast<unsigned char>(c), 0x20) << name;
            }
            EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(3)) << name;
            EXPECT_EQ(outcome, policy[name]) << name;
        }
    }
    EXPECT_EQ(files, policy.size());
}

TEST(Environment, OnlyRegularFiles) {
    EXPECT_THROW((void)load_environment("/dev/zero"), Failure);
    EXPECT_THROW((void)load_environment("."), Failure);
    EXPECT_THROW((void)load_environment("no-such-file.hdr"), Failure);
}

TEST(Sky, SunTurnsAndUpIsBright) {
    const Image a = sky(128, 64, 0);
    const auto at = [](const Image& image, float x, float y, float z) {
        float c[3];
        sample_latlong(image, x, y, z, c);
        return c[0] + c[1] + c[2];
    };
    EXPECT_GT(at(a, 0, 1, 0), at(a, 0, -1, 0));
    const float height = std::sin(0.75f), ring = std::cos(0.75f);
    const float sun = at(a, ring * std::cos(0.6f), height, ring * std::sin(0.6f));
    EXPECT_GT(sun, 5 * at(a, 0, 1, 0));
    const float angle = 0.6f + 1.57079633f;
    EXPECT_NEAR(at(sky(128, 64, 0.25), ring * std::cos(angle), height, ring * std::sin(angle)), sun,
                0.02 * sun);
    for (const float value : a.rgb)
        EXPECT_GE(value, 0);
}

TEST(Environment, SampleFollowsTheLayout) {
    Image image{8, 4, std::vector<float>(8 * 4 * 3, 0.0f)};
    const auto mark = [&](uint32_t x, uint32_t y, float value) { image.rgb[(y * 8 + x) * 3] = value; };
    // Pixel centres: column 4.5 / 8 is 1/16 of a turn past +x, towards +z.
    mark(4, 1, 7);
    const float phi = 2 * 3.14159265f / 16, theta = 3.14159265f * 1.5f / 4;
    float c[3];
    sample_latlong(image, std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi),
                   c);
    EXPECT_NEAR(c[0], 7, 1e-4);
    mark(0, 2, NAN);
    sample_latlong(image, -1, -0.4f, 0, c);
    EXPECT_TRUE(std::isfinite(c[0]));
}

TEST(Picture, EncodedPicturesDecode) {
    Picture picture(5, 3);
    for (size_t k = 0; k < picture.rgb.size(); ++k)
        picture.rgb[k] = static_cast<uint8_t>(17 * k);
    const std::string png = encode_png(picture);
    int width = 0, height = 0, channels = 0;
    unsigned char* decoded =
        stbi_load_from_memory(reinterpret_cast<const unsigned char*>(png.data()),
                              static_cast<int>(png.size()), &width, &height, &channels, 3);
    ASSERT_NE(decoded, nullptr);
    EXPECT_EQ(width, 5);
    EXPECT_EQ(height, 3);
    EXPECT_EQ(std::memcmp(decoded, picture.rgb.data(), picture.rgb.size()), 0);
    stbi_image_free(decoded);

    const std::string jpeg = encode_jpeg(picture, 90);
    decoded = stbi_load_from_memory(reinterpret_cast<const unsigned char*>(jpeg.data()),
                                    static_cast<int>(jpeg.size()), &width, &height, &channels, 3);
    ASSERT_NE(decoded, nullptr);
    EXPECT_EQ(width, 5);
    stbi_image_free(decoded);
}

TEST(Picture, ToneMapRisesFromBlackToWhite) {
    Image image{256, 1, std::vector<float>(256 * 3)};
    for (size_t k = 0; k < image.rgb.size(); ++k)
        image.rgb[k] = static_cast<float>(k / 3) * 0.05f;
    image.rgb[0] = -1;
    image.rgb[1] = NAN;
    const Picture picture = tone_map(image, 1);
    EXPECT_EQ(picture.rgb[0], 0);
    EXPECT_EQ(picture.rgb[1], 0);
    for (size_t k = 5; k < picture.rgb.size(); ++k)
        EXPECT_GE(picture.rgb[k], picture.rgb[k - 3]);
    EXPECT_GT(picture.rgb.back(), 250);
}

TEST(Picture, ToneMapTakesAnyNumber) {
    const Image image{2, 2, {1e19f, 1e38f, INFINITY, NAN, -1, -INFINITY, 0, -NAN, 1e-45f, 3e38f, 1e6f, 1e7f}};
    for (const float exposure : {1.0f, 1e30f}) {
        const Picture picture = tone_map(image, exposure);
        for (const size_t white : {0u, 1u, 2u, 9u, 10u, 11u})
            EXPECT_EQ(picture.rgb[white], 255) << white;
        for (const size_t black : {3u, 4u, 5u, 6u, 7u, 8u})
            EXPECT_EQ(picture.rgb[black], 0) << black;
    }
}

TEST(Picture, BesideKeepsPixels) {
    Picture a(2, 2), b(1, 2);
    a.rgb.assign(a.rgb.size(), 10);
    b.rgb.assign(b.rgb.size(), 20);
    const Picture both = beside({&a, &b}, 3);
    EXPECT_EQ(both.width, 6u);
    EXPECT_EQ(both.rgb[0], 10);
    EXPECT_EQ(both.rgb[2 * 3], 255);
    EXPECT_EQ(both.rgb[5 * 3], 20);
}

} // namespace
} // namespace nusselt::tools
