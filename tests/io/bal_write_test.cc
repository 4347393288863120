#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <limits>
#include <random>
#include <string>

#include <gtest/gtest.h>
#include <sys/resource.h>

#include "inceres/io/bal.h"
#include "support/temp_dir.h"

namespace inceres {
namespace {

using test::ReadBytes;
using test::TempDir;
using test::WriteBytes;

// Any finite double, of any exponent: what a printed form with too few digits would change.
double AnyDouble(std::mt19937_64* random) {
  for (;;) {
    const std::uint64_t bits = (*random)();
    double value = 0.0;
    std::memcpy(&value, &bits, sizeof(value));
    if (std::isfinite(value)) {
      return value;
    }
  }
}

BalProblem MakeProblem(int num_cameras, int num_points, int num_observations) {
  std::mt19937_64 random(5);
  BalProblem problem;
  problem.num_cameras = num_cameras;
  problem.num_points = num_points;
  for (int i = 0; i < num_observations; ++i) {
    problem.observations.push_back(
        {i % num_cameras, i % num_points, AnyDouble(&random), AnyDouble(&random)});
  }
  problem.cameras.resize(static_cast<std::size_t>(num_cameras) * 9);
  problem.points.resize(static_cast<std::size_t>(num_points) * 3);
  for (double& value : problem.cameras) {
    value = AnyDouble(&random);
  }
  for (double& value : problem.points) {
    value = AnyDouble(&random);
  }
  problem.points[0] = -0.0;
  problem.points[1] = std::numeric_limits<double>::denorm_min();
  return problem;
}

// Same bits (-0.0 is not 0.0).
void ExpectSameBits(const std::vector<double>& a, const std::vector<double>& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(double)), 0);
}

void ExpectSame(const BalProblem& a, const BalProblem& b) {
  EXPECT_EQ(a.num_cameras, b.num_cameras);
  EXPECT_EQ(a.num_points, b.num_points);
  ASSERT_EQ(a.observations.size(), b.observations.size());
  for (std::size_t i = 0; i < a.observations.size(); ++i) {
    ASSERT_EQ(a.observations[i].camera, b.observations[i].camera);
    ASSERT_EQ(a.observations[i].point, b.observations[i].point);
    ASSERT_EQ(a.observations[i].x, b.observations[i].x);
    ASSERT_EQ(a.observations[i].y, b.observations[i].y);
  }
  ExpectSameBits(a.cameras, b.cameras);
  ExpectSameBits(a.points, b.points);
}

class BalCompression : public ::testing::TestWithParam<const char*> {
 protected:
  std::string File(const std::string& name) const { return dir_.File(name + GetParam()); }
  bool IsPlain() const { return std::string(GetParam()) == ".txt"; }

  TempDir dir_;
};

class BalCompressed : public BalCompression {};  // not plain text

TEST_P(BalCompression, RoundTripKeepsEveryBit) {
  const BalProblem problem = MakeProblem(7, 300, 20000);  // larger than every buffer
  Status status = WriteBal(File("a"), problem);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_FALSE(std::filesystem::exists(File("a") + ".partial"));
  BalProblem read;
  status = ReadBal(File("a"), &read);
  ASSERT_TRUE(status.ok()) << status.message;
  ExpectSame(problem, read);
}

TEST_P(BalCompressed, SeveralStreamsInOneFile) {
  // Two problems in two compressed streams: the second is data after the last point, which only a
  // reader of both can see.
  ASSERT_TRUE(WriteBal(File("a"), MakeProblem(2, 5, 10)).ok());
  WriteBytes(File("b"), ReadBytes(File("a")) + ReadBytes(File("a")));
  BalProblem read;
  const Status status = ReadBal(File("b"), &read);
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_NE(status.message.find("after the last point"), std::string::npos) << status.message;
}

TEST_P(BalCompression, EveryTruncationIsAnError) {
  ASSERT_TRUE(WriteBal(File("a"), MakeProblem(2, 5, 10)).ok());
  const std::string bytes = ReadBytes(File("a"));
  // Of plain text the last number may lose digits and stay a number: the separator is what is
  // missing then.
  const std::size_t last =
      IsPlain() ? bytes.find_last_of('\n', bytes.size() - 2) : bytes.size() - 1;
  for (std::size_t size = 0; size <= last; ++size) {
    WriteBytes(File("b"), bytes.substr(0, size));
    BalProblem read;
    const Status status = ReadBal(File("b"), &read);
    ASSERT_EQ(status.code, StatusCode::kIo) << size;
    ASSERT_NE(status.message.find(IsPlain() ? "ends here" : "truncated"), std::string::npos)
        << size << " " << status.message;
    ASSERT_EQ(status.message.find(File("b") + ":"), 0u) << status.message;
    ASSERT_EQ(read.num_cameras, 0);
  }
}

TEST_P(BalCompressed, EveryDamagedByteOfCompressedDataIsFound) {
  const BalProblem problem = MakeProblem(2, 5, 10);
  ASSERT_TRUE(WriteBal(File("a"), problem).ok());
  const std::string bytes = ReadBytes(File("a"));
  int errors = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    WriteBytes(File("b"), damaged);
    BalProblem read;
    const Status status = ReadBal(File("b"), &read);
    if (status.ok()) {
      ExpectSame(problem, read);  // a time stamp or flag of the header: no harm
    } else {
      EXPECT_EQ(status.code, StatusCode::kIo);
      ++errors;
    }
  }
  EXPECT_GE(errors, static_cast<int>(bytes.size()) - 10);
}

TEST_P(BalCompressed, TextUnderACompressedNameIsAnError) {
  WriteBytes(File("a"), "1 1 1\n0 0 1 1\n1 2 3 4 5 6 7 8 9 1 2 3\n");
  BalProblem read;
  const Status status = ReadBal(File("a"), &read);
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_NE(status.message.find("corrupt"), std::string::npos) << status.message;
}

TEST_P(BalCompression, FailedWriteIsReportedAndKeepsTheOldFile) {
  WriteBytes(File("a"), "precious");
  // A limit on the size of files acts like a full disk.
  struct rlimit old_limit {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &old_limit), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  struct rlimit limit = old_limit;
  limit.rlim_cur = 100000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  const Status status = WriteBal(File("a"), MakeProblem(7, 300, 20000));
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &old_limit), 0);
  std::signal(SIGXFSZ, old_handler);
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_EQ(status.message, File("a") + ": cannot write: File too large");
  EXPECT_EQ(ReadBytes(File("a")), "precious");
  EXPECT_FALSE(std::filesystem::exists(File("a") + ".partial"));
}

TEST_P(BalCompression, UnwritablePath) {
  const std::string path = dir_.File(std::string("no/such/directory") + GetParam());
  const Status status = WriteBal(path, MakeProblem(2, 5, 10));
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_EQ(status.message, path + ": cannot open for writing: No such file or directory");
}

INSTANTIATE_TEST_SUITE_P(All, BalCompression, ::testing::Values(".txt", ".gz", ".bz2"),
                         [](const auto& instance) {
                           return std::string(instance.param).substr(1);
                         });

INSTANTIATE_TEST_SUITE_P(All, BalCompressed, ::testing::Values(".gz", ".bz2"),
                         [](const auto& instance) {
                           return std::string(instance.param).substr(1);
                         });

TEST(BalWrite, FullDevice) {
  if (!std::filesystem::exists("/dev/full")) {
    GTEST_SKIP() << "needs /dev/full";
  }
  const Status status = WriteBal("/dev/full", MakeProblem(2, 5, 10));
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_EQ(status.message, "/dev/full: cannot write: No space left on device");
  EXPECT_TRUE(std::filesystem::exists("/dev/full"));
}

TEST(BalWrite, DirectoryIsNotReplaced) {
  TempDir dir;
  const Status status = WriteBal(dir.path(), MakeProblem(2, 5, 10));
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_EQ(status.message, dir.path() + ": cannot write: is a directory");
}

TEST(BalWrite, LinkStaysALink) {
  TempDir dir;
  WriteBytes(dir.File("real.txt"), "old");
  std::filesystem::create_symlink(dir.File("real.txt"), dir.File("link.txt"));
  ASSERT_TRUE(WriteBal(dir.File("link.txt"), MakeProblem(2, 5, 10)).ok());
  EXPECT_TRUE(std::filesystem::is_symlink(dir.File("link.txt")));
  BalProblem read;
  EXPECT_TRUE(ReadBal(dir.File("real.txt"), &read).ok());
}

TEST(BalWrite, InvalidProblemsAreNamedAndNotWritten) {
  TempDir dir;
  const auto expect = [&dir](const BalProblem& problem, const std::string& what) {
    const Status status = WriteBal(dir.File("a.txt"), problem);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument) << what;
    EXPECT_NE(status.message.find(what), std::string::npos) << status.message;
    EXPECT_FALSE(std::filesystem::exists(dir.File("a.txt")));
  };
  const BalProblem good = MakeProblem(2, 5, 10);
  BalProblem bad = good;
  bad.observations[3].camera = 2;
  expect(bad, "observations[3].camera is 2, not between 0 and 1");
  bad = good;
  bad.observations[4].point = -1;
  expect(bad, "observations[4].point is -1, not between 0 and 4");
  bad = good;
  bad.observations[1].y = std::nan("");
  expect(bad, "observations[1] is not finite");
  bad = good;
  bad.cameras[11] = std::numeric_limits<double>::infinity();
  expect(bad, "cameras[11] is not finite");
  bad = good;
  bad.points.pop_back();
  expect(bad, "points has 14 values instead of 15");
  bad = good;
  bad.observations.clear();
  expect(bad, "has 0 observations");
  expect(BalProblem(), "needs at least one camera");
}

}  // namespace
}  // namespace inceres
