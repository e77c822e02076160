// One Vulkan device for all tests of a program, with the validation layer on: a test fails if the
// layer said anything while it ran.
#pragma once

#include "gpu/gpu.h"
#include "lpvbake/error.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>

namespace lpvbake::testing {

class DeviceTest : public ::testing::Test {
protected:
    static void SetUpTestSuite() {
        if (shared || !reason.empty())
            return;
        try {
            shared = std::make_unique<gpu::Device>(gpu::DeviceOptions{"", true});
        } catch (const Error& error) {
            if (error.kind != ErrorKind::device)
                throw;
            reason = error.what();
        }
    }

    void SetUp() override {
        if (!shared)
            GTEST_SKIP() << reason;
    }

    void TearDown() override {
        if (!shared)
            return;
        try {
            shared->check_validation();
        } catch (const Error& error) {
            ADD_FAILURE() << error.what();
        }
    }

    static gpu::Device& device() { return *shared; }

private:
    /// Closes the device before main ends: the driver's own globals are gone when ours go.
    struct Closer : ::testing::Environment {
        void TearDown() override { shared.reset(); }
    };

    inline static std::unique_ptr<gpu::Device> shared;
    inline static std::string reason; ///< why there is no device
    inline static ::testing::Environment* const closer =
        ::testing::AddGlobalTestEnvironment(new Closer);
};

} // namespace lpvbake::testing
