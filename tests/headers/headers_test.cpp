#include "nusselt/nusselt.h"

#include <gtest/gtest.h>

#include <string>

TEST(Headers, VersionOfHeaderAndLibraryAgree) {
    EXPECT_EQ(nusselt::version(), uint32_t{NUSSELT_VERSION});
    EXPECT_EQ(std::string(nusselt::configuration()).find('\n'), std::string::npos);
}
