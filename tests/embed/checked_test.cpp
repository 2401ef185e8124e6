// A checked build finds out that a borrowed array was written in flight.
#include "tests/embed/fixture.h"

namespace nusselt::test {

namespace {

TEST(Checked, SaysSo) {
    EXPECT_TRUE(has_feature(Feature::checked));
    EXPECT_NE(std::string(configuration()).find("checked"), std::string::npos);
}

TEST(Checked, FindsAWriteToPositionsOrNormals) {
    Host host("cloth");
    for (float* target : {&host.pose.positions[0][7].y, &host.pose.normals[1][0].x}) {
        FrameId id;
        FrameStats stats;
        ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
        const float before = *target;
        *target += 1;
        const Status status = wait(host.context, id, &stats);
        EXPECT_EQ(status.code, StatusCode::changed) << status.text;
        EXPECT_GT(std::string(status.text).size(), 40u);
        EXPECT_GT(stats.receivers, 0u);
        EXPECT_EQ(wait(host.context, id, nullptr).code, StatusCode::stale_handle); // the handle is spent
        *target = before;
        ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
        EXPECT_TRUE(wait(host.context, id, nullptr).ok());
    }
}

TEST(Checked, BytesBetweenTheElementsAreTheHosts) {
    Host host("cloth");
    const size_t count = host.meshes[0].positions.count;
    std::vector<float> wide(4 * count);
    for (size_t v = 0; v < count; ++v)
        std::copy_n(&host.pose.positions[0][v].x, 3, &wide[4 * v]);
    host.meshes[0].positions = {wide.data(), count, 16};
    FrameId id;
    ASSERT_TRUE(submit(host.context, host.frame(), &id).ok());
    wide[3] = wide.back() = 7;
    EXPECT_TRUE(wait(host.context, id, nullptr).ok());
}

} // namespace

} // namespace nusselt::test
