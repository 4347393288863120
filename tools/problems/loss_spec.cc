#include "tools/problems/loss_spec.h"

#include <cassert>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <system_error>

#include "inceres/problem/losses.h"

namespace inceres::tools {

Status ParseLoss(const std::string& text, LossSpec* spec) {
  if (text == "none") {
    *spec = LossSpec{};
    return Status::Ok();
  }
  const std::size_t colon = text.find(':');
  const std::string name = text.substr(0, colon);
  if ((name != "huber" && name != "cauchy") || colon == std::string::npos) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "'" + text + "' is not a loss: use none, huber:A or cauchy:A");
  }
  const std::string number = text.substr(colon + 1);
  char* end = nullptr;
  const double scale = std::strtod(number.c_str(), &end);
  if (number.empty() || *end != '\0' || !std::isfinite(scale) || scale <= 0.0) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "'" + text + "': the scale '" + number + "' is not a positive number");
  }
  *spec = {name == "huber" ? LossSpec::Kind::kHuber : LossSpec::Kind::kCauchy, scale};
  return Status::Ok();
}

std::string ToString(const LossSpec& spec) {
  if (spec.kind == LossSpec::Kind::kNone) {
    return "none";
  }
  char number[32];
  // the shortest that reads back
  const auto [end, error] = std::to_chars(number, number + sizeof(number), spec.scale);
  assert(error == std::errc());
  return (spec.kind == LossSpec::Kind::kHuber ? "huber:" : "cauchy:") + std::string(number, end);
}

std::shared_ptr<const Loss> MakeCoreLoss(const LossSpec& spec) {
  switch (spec.kind) {
    case LossSpec::Kind::kHuber:
      return std::make_shared<HuberLoss>(spec.scale);
    case LossSpec::Kind::kCauchy:
      return std::make_shared<CauchyLoss>(spec.scale);
    case LossSpec::Kind::kNone:
      break;
  }
  return nullptr;
}

}  // namespace inceres::tools
