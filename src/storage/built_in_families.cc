#include <array>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <type_traits>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/bearing.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/center_distance.h"
#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/inverse_depth_reprojection.h"
#include "inceres/factors/landmark_position.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_edge.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/factors/relative_similarity.h"
#include "inceres/factors/stereo_reprojection.h"
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

// A family that is made with nothing.
template <typename Family>
void AddPlainFamily(const char* name, GraphFormats* formats) {
  Add<Family>(
      name, formats, [](const Family&, GraphWriter*) {},
      [](GraphReader*) { return std::make_shared<Family>(); });
}

// Of families that see a landmark: its parametrization, and on which side a pose is perturbed.
template <typename Family>
void WriteLandmark(const Family& family, GraphWriter* writer) {
  writer->WriteInt(static_cast<std::int32_t>(family.landmark()));
  writer->WriteInt(static_cast<std::int32_t>(family.perturbation()));
}

// ReadEnum takes the last enumerator for the limit: one that is added behind it belongs here as
// well.
LandmarkKind ReadLandmark(GraphReader* reader) {
  return reader->ReadEnum(LandmarkKind::kHomogeneous, "the kind of landmark");
}

constexpr const char* kSide = "the side of perturbation";

Perturbation ReadSide(GraphReader* reader) {
  return reader->ReadEnum(Perturbation::kLeft, kSide);
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
  Add<BodyReprojectionFamily>(
      "body_reprojection", formats,
      [](const BodyReprojectionFamily& family, GraphWriter* writer) {
        // All that decides its slots and its formula, in the order of the constructor.
        writer->WriteInt(static_cast<std::int32_t>(family.time_offset()));
        writer->WriteInt(static_cast<std::int32_t>(family.feature()));
        writer->WriteInt(static_cast<std::int32_t>(family.views()));
        writer->WriteInt(static_cast<std::int32_t>(family.error()));
      },
      [](GraphReader* reader) {
        using Body = BodyReprojectionFamily;
        // One read a statement, for the order of arguments is not known.
        const auto offset = reader->ReadEnum(Body::TimeOffset::kEstimated, "the time offset");
        const auto feature = reader->ReadEnum(Body::Feature::kBearing, "the kind of feature");
        const auto views = reader->ReadEnum(Body::Views::kOnePoseTwoCameras, "the views");
        const auto error = reader->ReadEnum(Body::Error::kUnitSphere, "the kind of error");
        return std::make_shared<Body>(offset, feature, views, error);
      });
  AddPlainFamily<InverseDepthReprojectionFamily>("inverse_depth_reprojection", formats);
}

// A family that sees landmarks with one camera, whose fields stand in the file in this order.
template <typename Family, typename Camera, std::size_t num_fields>
void AddCameraFamily(const char* name, const std::array<double Camera::*, num_fields>& fields,
                     GraphFormats* formats) {
  Add<Family>(
      name, formats,
      [fields](const Family& family, GraphWriter* writer) {
        WriteLandmark(family, writer);
        for (double Camera::*const field : fields) {
          writer->WriteDouble(family.camera().*field);
        }
      },
      [fields](GraphReader* reader) {
        const LandmarkKind landmark = ReadLandmark(reader);
        const Perturbation side = ReadSide(reader);
        Camera camera;
        for (double Camera::*const field : fields) {
          camera.*field = reader->ReadDouble();
        }
        return std::make_shared<Family>(camera, landmark, side);
      });
}

void AddPointFamilies(GraphFormats* formats) {
  Add<BearingFamily>("bearing", formats, WriteLandmark<BearingFamily>, [](GraphReader* reader) {
    const LandmarkKind landmark = ReadLandmark(reader);
    // One read a statement: arguments are evaluated in no order that is known.
    return std::make_shared<BearingFamily>(landmark, ReadSide(reader));
  });
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

// A family that is made with one enumeration, which `get` reads: `last` is its last enumerator.
template <typename Family, typename Enum>
void AddKind(const char* name, Enum (Family::*get)() const, Enum last, const char* what,
             GraphFormats* formats) {
  Add<Family>(
      name, formats,
      [get](const Family& family, GraphWriter* writer) {
        writer->WriteInt(static_cast<std::int32_t>((family.*get)()));
      },
      [last, what](GraphReader* reader) {
        return std::make_shared<Family>(reader->ReadEnum(last, what));
      });
}

// Families between poses and of single variables; most are told apart by one enumeration, if by
// any.
void AddPoseFamilies(GraphFormats* formats) {
  AddPlainFamily<RelativePoseFamily>("relative_pose", formats);
  AddPlainFamily<PlanarRelativePoseFamily>("planar_relative_pose", formats);
  AddPlainFamily<SpeedBiasPriorFamily>("speed_bias_prior", formats);
  AddPlainFamily<SpatialLandmarkFamily>("spatial_landmark", formats);
  AddPlainFamily<PositionPriorFamily>("position_prior", formats);
  AddKind("planar_landmark", &PlanarLandmarkFamily::sighting, PlanarSighting::kRangeBearing,
          "the kind of sighting", formats);
  // The side of the perturbation decides how the residual is measured, not only its Jacobian.
  AddKind("pose_prior", &PosePriorFamily::side, Perturbation::kLeft, kSide, formats);
  AddKind("pose_edge", &PoseEdgeFamily::convention, PoseErrorConvention::kGtsam,
          "the convention of the error", formats);
  AddKind("relative_similarity", &RelativeSimilarityFamily::convention,
          SimilarityErrorConvention::kLogarithm, "the convention of the error", formats);
  AddKind("center_distance", &CenterDistanceFamily::kind, CenterKind::kPlanarPose,
          "the kind of center", formats);
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
