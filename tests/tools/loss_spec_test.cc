#include "tools/problems/loss_spec.h"

#include <gtest/gtest.h>

#include "tools/problems/ceres_loss.h"

namespace inceres::tools {
namespace {

TEST(ParseLoss, ReadsWhatToStringWrites) {
  for (const char* text : {"none", "huber:1.5", "cauchy:0.1", "huber:1e-07"}) {
    LossSpec spec;
    const Status status = ParseLoss(text, &spec);
    ASSERT_TRUE(status.ok()) << status.message;
    EXPECT_EQ(ToString(spec), text);
  }
}

TEST(ParseLoss, NamesWhatIsWrongAndChangesNothing) {
  for (const char* text : {"", "huber", "huber:", "huber:0", "huber:-1", "huber:nan", "huber:1x",
                           "tukey:1", "none:1", "cauchy:inf"}) {
    LossSpec spec{LossSpec::Kind::kHuber, 3.0};
    const Status status = ParseLoss(text, &spec);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument) << text;
    EXPECT_NE(status.message.find("'" + std::string(text) + "'"), std::string::npos)
        << status.message;
    EXPECT_EQ(ToString(spec), "huber:3");
  }
}

TEST(MakeLoss, CeresAndCoreAgree) {
  for (const char* text : {"huber:1.5", "cauchy:0.7"}) {
    LossSpec spec;
    ASSERT_TRUE(ParseLoss(text, &spec).ok());
    for (const double s : {0.0, 0.3, 2.25, 40.0}) {
      double ceres_rho[3];
      double core_rho[3];
      MakeCeresLoss(spec)->Evaluate(s, ceres_rho);
      MakeCoreLoss(spec)->Evaluate(s, core_rho);
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(ceres_rho[k], core_rho[k], 1e-15 * (1.0 + std::abs(ceres_rho[k])))
            << text << " at " << s;
      }
    }
  }
  EXPECT_EQ(MakeCeresLoss({}), nullptr);
  EXPECT_EQ(MakeCoreLoss({}), nullptr);
}

}  // namespace
}  // namespace inceres::tools
