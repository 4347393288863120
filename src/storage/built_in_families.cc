#include <array>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <tuple>
#include <type_traits>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/gauge.h"
#include "inceres/factors/landmark_position.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"
#include "storage/built_in.h"

namespace inceres::internal {

// What a file has of each built-in family: the parameters that the constructor takes, and then all
// measurements, as they are. What follows from these is not written. Names, and
// the order of what is written, stay as they are, for files have them.
//
// Reading trusts nothing. Sizes and enumerations are asked for within their limits. After a failure
// reads go on and give something harmless, so that objects can be made of it, and the load as a
// whole fails.

namespace {

// The measurements of these families are structs of doubles, which stand in a file in the order of
// the struct's members: it must stay as it is.
template <typename Family>
constexpr std::size_t NumDoubles() {
  using Measurement = typename Family::Measurement;
  static_assert(std::is_trivially_copyable_v<Measurement> &&
                alignof(Measurement) == alignof(double));
  return sizeof(Measurement) / sizeof(double);
}

template <typename Family>
void WriteMeasurements(const Family& family, GraphWriter* writer) {
  double values[NumDoubles<Family>()];
  writer->WriteLong(family.size());
  for (int i = 0; i < family.size(); ++i) {
    std::memcpy(values, &family.measurement(i), sizeof(values));
    writer->WriteDoubles(values, NumDoubles<Family>());
  }
}

template <typename Family>
void ReadMeasurements(Family* family, GraphReader* reader) {
  double values[NumDoubles<Family>()];
  const std::size_t size = reader->ReadCount(sizeof(values));
  if (size > static_cast<std::size_t>(INT32_MAX)) {
    reader->Fail("more measurements than a family can hold");
  }
  for (std::size_t i = 0; i < size && reader->ReadDoubles(values, NumDoubles<Family>()); ++i) {
    typename Family::Measurement measurement;
    std::memcpy(&measurement, values, sizeof(values));
    family->Add(measurement);
  }
}

// `write` and `make` are of what the family is made with; its measurements follow.
template <typename Family, typename Write, typename Make>
void Add(const char* name, GraphFormats* formats, Write write, Make make) {
  formats->AddFamily<Family>(
      std::string("inceres.") + name,
      // Parameters first: without them there is no family to read measurements into.
      [write](const Family& family, GraphWriter* writer) {
        write(family, writer);
        WriteMeasurements(family, writer);
      },
      [make](GraphReader* reader) -> std::shared_ptr<Family> {
        // Also after a failure: of the limits that reads fall back to a family can be made.
        const std::shared_ptr<Family> family = make(reader);
        ReadMeasurements(family.get(), reader);
        return family;
      });
}

// An enumeration that a family is made with, which `get` reads, and what a failure calls it.
// ReadEnum takes `last` for the limit: an enumerator that is added behind it belongs here as well.
template <typename Owner, typename Enum>
struct Kind {
  Enum (Owner::*get)() const;
  Enum last;
  const char* what;
};
template <typename Owner, typename Enum>
Kind(Enum (Owner::*)() const, Enum, const char*) -> Kind<Owner, Enum>;

constexpr const char* kLandmark = "the kind of landmark";
constexpr const char* kSide = "the side of perturbation";

// A family that is made with these enumerations, in the order of the constructor, or with nothing.
template <typename Family, typename... Owners, typename... Enums>
void AddMadeOf(const char* name, GraphFormats* formats, const Kind<Owners, Enums>&... kinds) {
  Add<Family>(
      name, formats,
      [kinds...](const Family& family, GraphWriter* writer) {
        (writer->WriteInt(static_cast<std::int32_t>((family.*kinds.get)())), ...);
      },
      [kinds...](GraphReader* reader) {
        // In braces, for arguments in parentheses are evaluated in no order that is known.
        const std::tuple<Enums...> read{reader->ReadEnum(kinds.last, kinds.what)...};
        return std::apply([](auto... made_of) { return std::make_shared<Family>(made_of...); },
                          read);
      });
}

void AddReprojections(GraphFormats* formats) {
  Add<BalReprojectionFamily>(
      "bal_reprojection", formats,
      [](const BalReprojectionFamily& family, GraphWriter* writer) {
        // Smaller than the ambient size where the caller has manifolds of his own, as for fixed
        // intrinsics.
        writer->WriteInt(family.slot(0).tangent_size);
        writer->WriteInt(family.slot(1).tangent_size);
      },
      [](GraphReader* reader) {
        const int camera = reader->ReadIntIn(0, 9, "the tangent size of a camera");
        const int point = reader->ReadIntIn(0, 3, "the tangent size of a point");
        return std::make_shared<BalReprojectionFamily>(camera, point);
      });
  using Body = BodyReprojectionFamily;
  // All that decides its slots and its formula.
  AddMadeOf<Body>("body_reprojection", formats,
                  Kind{&Body::time_offset, Body::TimeOffset::kEstimated, "the time offset"},
                  Kind{&Body::feature, Body::Feature::kBearing, "the kind of feature"},
                  Kind{&Body::views, Body::Views::kOnePoseTwoCameras, "the views"},
                  Kind{&Body::error, Body::Error::kUnitSphere, "the kind of error"});
  AddMadeOf<InverseDepthReprojectionFamily>("inverse_depth_reprojection", formats);
}

// A family that sees landmarks with one camera. In the file: the landmark's parametrization, on
// which side a pose is perturbed, and the camera's fields in this order.
template <typename Family, typename Camera, std::size_t num_fields>
void AddCameraFamily(const char* name, const std::array<double Camera::*, num_fields>& fields,
                     GraphFormats* formats) {
  Add<Family>(
      name, formats,
      [fields](const Family& family, GraphWriter* writer) {
        writer->WriteInt(static_cast<std::int32_t>(family.landmark()));
        writer->WriteInt(static_cast<std::int32_t>(family.perturbation()));
        for (double Camera::*const field : fields) {
          writer->WriteDouble(family.camera().*field);
        }
      },
      [fields](GraphReader* reader) {
        const auto landmark = reader->ReadEnum(LandmarkKind::kHomogeneous, kLandmark);
        const auto side = reader->ReadEnum(Perturbation::kLeft, kSide);
        Camera camera;
        for (double Camera::*const field : fields) {
          camera.*field = reader->ReadDouble();
        }
        return std::make_shared<Family>(camera, landmark, side);
      });
}

void AddPointFamilies(GraphFormats* formats) {
  AddMadeOf<BearingFamily>("bearing", formats,
                           Kind{&BearingFamily::landmark, LandmarkKind::kHomogeneous, kLandmark},
                           Kind{&BearingFamily::perturbation, Perturbation::kLeft, kSide});
  using Pinhole = PinholeCamera;
  AddCameraFamily<PointReprojectionFamily>(
      "point_reprojection",
      std::array{&Pinhole::f_x, &Pinhole::f_y, &Pinhole::c_x, &Pinhole::c_y, &Pinhole::k1,
                 &Pinhole::k2, &Pinhole::p1, &Pinhole::p2},
      formats);
  using Fisheye = EquidistantCamera;
  AddCameraFamily<EquidistantReprojectionFamily>(
      "equidistant_reprojection",
      std::array{&Fisheye::f_x, &Fisheye::f_y, &Fisheye::c_x, &Fisheye::c_y, &Fisheye::k1,
                 &Fisheye::k2, &Fisheye::k3, &Fisheye::k4},
      formats);
  // Without distortion: stereo images are rectified.
  using Stereo = StereoCamera;
  AddCameraFamily<StereoReprojectionFamily>(
      "stereo_reprojection",
      std::array{&Stereo::f_x, &Stereo::f_y, &Stereo::c_x, &Stereo::c_y, &Stereo::baseline},
      formats);
}

// Families between poses and of single variables; most are told apart by one enumeration, if by
// any.
void AddPoseFamilies(GraphFormats* formats) {
  AddMadeOf<RelativePoseFamily>("relative_pose", formats);
  AddMadeOf<PlanarRelativePoseFamily>("planar_relative_pose", formats);
  AddMadeOf<SpeedBiasPriorFamily>("speed_bias_prior", formats);
  AddMadeOf<SpatialLandmarkFamily>("spatial_landmark", formats);
  AddMadeOf<PositionPriorFamily>("position_prior", formats);
  AddMadeOf<PlanarLandmarkFamily>(
      "planar_landmark", formats,
      Kind{&PlanarLandmarkFamily::sighting, PlanarSighting::kRangeBearing, "the kind of sighting"});
  // The side of the perturbation decides how the residual is measured, not only its Jacobian.
  AddMadeOf<PosePriorFamily>("pose_prior", formats,
                             Kind{&PosePriorFamily::side, Perturbation::kLeft, kSide});
  constexpr const char* kConvention = "the convention of the error";
  AddMadeOf<PoseEdgeFamily>(
      "pose_edge", formats,
      Kind{&PoseEdgeFamily::convention, PoseErrorConvention::kGtsam, kConvention});
  AddMadeOf<RelativeSimilarityFamily>("relative_similarity", formats,
                                      Kind{&RelativeSimilarityFamily::convention,
                                           SimilarityErrorConvention::kLogarithm, kConvention});
  AddMadeOf<CenterDistanceFamily>(
      "center_distance", formats,
      Kind{&CenterDistanceFamily::kind, CenterKind::kPlanarPose, "the kind of center"});
}

}  // namespace

void AddBuiltInFamilies(GraphFormats* formats) {
  AddReprojections(formats);
  AddPointFamilies(formats);
  AddPoseFamilies(formats);
  // Those whose measurements differ in size are in vector_families.cc.
  AddVectorFamilies(formats);
}

}  // namespace inceres::internal
