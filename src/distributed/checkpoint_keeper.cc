#include "distributed/checkpoint_keeper.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <system_error>

namespace inceres::internal {

// Checkpoints of a distributed solve: where the trust-region loop stands, the values of all
// variables that move, and the scale of their columns as iteration 0 has measured it. Every
// variable is written by one rank: a frame by its owner, a landmark by the rank that has it.
//
// Writing takes four collective steps, so that ranks never part: make an empty file; exchange sizes
// and checksums; write, each rank its section and rank 0 the head; rename. A failure at any of them
// is one of all ranks, is remembered, and leaves the last whole file under its name: the new one is
// `path`.partial until the rename, and is flushed to the disk before.
//
// Reading is by ids, so the number of ranks may be another. What is read must cover all variables
// that move here, each once; else nothing is taken over.

namespace {

Status FileError(const std::string& path, const char* what, int error) {
  return Status::Error(StatusCode::kIo,
                       path + ": " + what + ": " + std::generic_category().message(error));
}

// Writes into a file that exists, at this rank's offset; other ranks write elsewhere in it at the
// same time.
Status WriteAt(const std::string& path, std::int64_t offset, const std::vector<char>& bytes) {
  const int file = open(path.c_str(), O_WRONLY | O_CLOEXEC);
  if (file < 0) {
    return FileError(path, "cannot open for writing", errno);
  }
  int error = WriteAll(bytes, offset, [&](const char* from, std::size_t count, std::int64_t at) {
    return pwrite(file, from, count, static_cast<off_t>(at));
  });
  // The bytes are on the disk before the file gets its name.
  if (error == 0 && Uninterrupted([&] { return fsync(file); }) != 0) {
    error = errno;
  }
  close(file);
  return error == 0 ? Status::Ok() : FileError(path, "cannot write", error);
}

// Rank 0 alone truncates, and all others open afterwards: a leftover of an earlier attempt may be
// longer than what is written now.
Status MakeEmpty(const std::string& path) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) {
    return FileError(path, "cannot open for writing", errno);
  }
  close(file);
  return Status::Ok();
}

bool AllFinite(const double* values, int count) {
  return std::all_of(values, values + count, [](double x) { return std::isfinite(x); });
}

}  // namespace

// Maps the landmarks of the layout to ids once, and checks these: a file from which nobody could go
// on is not written. Without a path nothing is asked of GraphPart::landmarks, and no call of the
// ranks made: options are the same on all, so all skip it. Variables that do not move have no
// place, and are not written.
CheckpointKeeper::CheckpointKeeper(const DistributedOptions& options, const Communicator& ranks,
                                   const GraphPart& part, const SharedFrames& frames,
                                   const Layout& layout)
    : options_(options), ranks_(ranks), part_(part), frames_(frames), layout_(layout) {
  if (options.checkpoint.path.empty() && options.checkpoint.resume.empty()) {
    return;
  }
  landmark_ids_.assign(static_cast<std::size_t>(layout.num_landmarks()), -1);
  for (const GlobalVariable& landmark : part.landmarks) {
    const bool known = part.graph->HasVariable(landmark.variable);
    const int position = known ? layout.Position(landmark.variable) : -1;
    if (position >= layout.num_frames) {
      landmark_ids_[static_cast<std::size_t>(position - layout.num_frames)] = landmark.id;
    }
  }
  num_landmarks_ = static_cast<std::int64_t>(ranks.Sum(layout.num_landmarks()));
  checked_ = CheckLandmarks();
}

Status CheckpointKeeper::CheckOwnLandmarks() const {
  const auto nameless = std::find_if(landmark_ids_.begin(), landmark_ids_.end(),
                                     [](std::int64_t id) { return id < 0; });
  if (nameless == landmark_ids_.end()) {
    return Status::Ok();
  }
  const auto position = static_cast<std::size_t>(nameless - landmark_ids_.begin());
  const VariableId id = layout_.variables[static_cast<std::size_t>(layout_.num_frames) + position];
  return Status::Error(StatusCode::kInvalidArgument,
                       "landmark variable " + std::to_string(id) +
                           " is not listed in GraphPart::landmarks with an id of 0 or more, as "
                           "checkpoints need");
}

// Collective. What is written must be found again by its id: no two landmarks may have the same,
// here or on two ranks. All of one id go to the same rank, which compares them. Frames have been
// compared by SharedFrames.
Status CheckpointKeeper::CheckLandmarks() const {
  struct Listed {
    std::int64_t id;
    std::int64_t rank;
  };
  const auto num_ranks = static_cast<std::size_t>(ranks_.size());
  std::vector<std::vector<Listed>> to_rank(num_ranks);
  Status status = ranks_.Try([&] {
    Status own = CheckOwnLandmarks();
    for (std::size_t l = 0; own.ok() && l < landmark_ids_.size(); ++l) {
      const std::int64_t id = landmark_ids_[l];
      to_rank[static_cast<std::size_t>(id) % num_ranks].push_back({id, ranks_.rank()});
    }
    return own;
  });
  if (!status.ok()) {
    return status;
  }
  std::vector<Listed> received = ranks_.SendToEach(std::move(to_rank));
  std::stable_sort(received.begin(), received.end(),
                   [](const Listed& a, const Listed& b) { return a.id < b.id; });
  const auto twice =
      std::adjacent_find(received.begin(), received.end(),
                         [](const Listed& a, const Listed& b) { return a.id == b.id; });
  if (twice != received.end()) {
    status = Status::Error(StatusCode::kInvalidArgument,
                           "GraphPart::landmarks has two of id " + std::to_string(twice->id) +
                               ", on rank " + std::to_string(twice->rank) + " and rank " +
                               std::to_string((twice + 1)->rank));
  }
  return ranks_.Agree(status);
}

// Iteration 0 is where the solve began: nothing to keep. The answer depends on options and the
// iteration alone, which are the same on all ranks, for Keep is collective.
bool CheckpointKeeper::Wants(int iteration) const {
  return !options_.checkpoint.path.empty() && iteration > 0 &&
         iteration % options_.checkpoint.every == 0;
}

void CheckpointKeeper::Keep(const LoopPosition& position, const std::vector<double>& state) {
  const Status status = Write(position, state);
  num_written_ += status.ok() ? 1 : 0;
  if (!status.ok()) {
    failure_ = status.message;
  }
}

// The section of this rank: its owned frames by id, then its landmarks in the order of the layout.
// Shared frames that others own are theirs to write. `position.scale` is packed as the layout is.
std::vector<char> CheckpointKeeper::EncodeOwn(const LoopPosition& position,
                                              const std::vector<double>& state) const {
  const FactorGraph& graph = *part_.graph;
  std::vector<char> bytes;
  const auto append = [&](std::int64_t id, std::int32_t kind, std::size_t at) {
    const VariableId variable = layout_.variables[at];
    CheckpointRecord record;
    record.id = id;
    record.kind = kind;
    record.ambient_size = graph.AmbientSize(variable);
    record.tangent_size = graph.TangentSize(variable);
    AppendRecord(record, graph.ValuesIn(state.data(), variable),
                 position.scale.data() + layout_.packed_offset[at], &bytes);
  };
  for (const int at : frames_.owned()) {
    append(frames_.moving()[static_cast<std::size_t>(at)].id, CheckpointRecord::kFrame,
           static_cast<std::size_t>(at));
  }
  for (std::size_t l = 0; l < landmark_ids_.size(); ++l) {
    append(landmark_ids_[l], CheckpointRecord::kLandmark,
           static_cast<std::size_t>(layout_.num_frames) + l);
  }
  return bytes;
}

// Collective. Ranks that failed before an agreement must not go on to the next collective call
// alone, so each status is agreed on first.
Status CheckpointKeeper::Write(const LoopPosition& position,
                               const std::vector<double>& state) const {
  if (!checked_.ok()) {
    return checked_;
  }
  const std::string partial = options_.checkpoint.path + ".partial";
  const bool root = ranks_.rank() == 0;
  std::vector<char> bytes;
  Status status = ranks_.Try([&] {
    bytes = EncodeOwn(position, state);
    return root ? MakeEmpty(partial) : Status::Ok();
  });
  if (!status.ok()) {
    return status;
  }
  // Checksums travel as signed numbers of the same bits.
  const std::vector<std::int64_t> table =
      ranks_.Gather({static_cast<std::int64_t>(bytes.size()),
                     static_cast<std::int64_t>(ChecksumOf(bytes.data(), bytes.size()))});
  std::vector<CheckpointSection> sections(table.size() / 2);
  for (std::size_t r = 0; r < sections.size(); ++r) {
    sections[r].bytes = table[2 * r];
    sections[r].checksum = static_cast<std::uint64_t>(table[2 * r + 1]);
  }
  CheckpointHead head;
  head.position = position;
  head.strategy_kind = static_cast<int>(options_.solver.strategy);
  // Of all ranks: to tell another problem, before a record is read.
  head.num_frames = frames_.num_frames();
  head.num_landmarks = num_landmarks_;
  // All ranks compute the same offsets from the same table; rank 0 alone writes the head.
  const std::vector<char> head_bytes = EncodeHead(head, &sections);
  status = ranks_.Try([&] {
    const Status own =
        WriteAt(partial, sections[static_cast<std::size_t>(ranks_.rank())].offset, bytes);
    return own.ok() && root ? WriteAt(partial, 0, head_bytes) : own;
  });
  if (!status.ok()) {
    return status;
  }
  // After the agreement all sections are on the disk.
  const bool renamed = !root || std::rename(partial.c_str(), options_.checkpoint.path.c_str()) == 0;
  return ranks_.Agree(renamed ? Status::Ok()
                              : FileError(options_.checkpoint.path, "cannot rename to it", errno));
}

// Each rank reads the file by itself; Try makes the first failure that of all.
Status CheckpointKeeper::Resume(LoopPosition* position, std::vector<double>* state) const {
  return checked_.ok() ? ranks_.Try([&] { return Read(position, state); }) : checked_;
}

Status CheckpointKeeper::CheckHead(const CheckpointHead& head) const {
  if (head.num_frames == frames_.num_frames() && head.num_landmarks == num_landmarks_ &&
      head.strategy_kind == static_cast<int>(options_.solver.strategy)) {
    return Status::Ok();
  }
  return Status::Error(
      StatusCode::kInvalidArgument,
      options_.checkpoint.resume + ": a checkpoint of " + std::to_string(head.num_frames) +
          " frames and " + std::to_string(head.num_landmarks) +
          " landmarks, or of another strategy; the problem has " +
          std::to_string(frames_.num_frames()) + " and " + std::to_string(num_landmarks_));
}

// Frames begin the layout. Ids of frames and landmarks are apart.
void CheckpointKeeper::FindPlaces(Places* frames, Places* landmarks) const {
  // Owned or not: a shared frame is read by all ranks that move it, and gets the same bits on each.
  for (std::size_t i = 0; i < frames_.moving().size(); ++i) {
    (*frames)[frames_.moving()[i].id] = i;
  }
  for (std::size_t l = 0; l < landmark_ids_.size(); ++l) {
    (*landmarks)[landmark_ids_[l]] = static_cast<std::size_t>(layout_.num_frames) + l;
  }
}

// Values and scales go into the solve unchecked from here on. A scale divides the damping, so it
// must be positive.
bool CheckpointKeeper::Fits(const CheckpointRecord& record, VariableId variable,
                            const double* values, const double* scale) const {
  return record.ambient_size == part_.graph->AmbientSize(variable) &&
         record.tangent_size == part_.graph->TangentSize(variable) &&
         AllFinite(values, record.ambient_size) && AllFinite(scale, record.tangent_size) &&
         *std::min_element(scale, scale + record.tangent_size) > 0.0;
}

// Checks what the head says of all ranks first, then fills *state and position->scale by id. A
// failure may leave *state half written: the caller gives a copy of the graph's.
Status CheckpointKeeper::Read(LoopPosition* position, std::vector<double>* state) const {
  const std::string& path = options_.checkpoint.resume;
  CheckpointReader reader;
  Status status = reader.Open(path);
  status = status.ok() ? CheckHead(reader.head()) : status;
  if (!status.ok()) {
    return status;
  }
  Places places[2];  // by kind
  FindPlaces(&places[CheckpointRecord::kFrame], &places[CheckpointRecord::kLandmark]);
  *position = reader.head().position;
  // 1 where nothing will be written; by the count below, nowhere.
  position->scale.assign(static_cast<std::size_t>(layout_.size()), 1.0);
  const std::size_t num_wanted = places[0].size() + places[1].size();
  // A variable that comes twice in a file is as wrong as one of another size.
  std::vector<char> found(layout_.variables.size(), 0);
  std::size_t num_found = 0;
  status = reader.ForEach([&](const CheckpointRecord& record, const double* values,
                              const double* scale) {
    if (record.kind != CheckpointRecord::kFrame && record.kind != CheckpointRecord::kLandmark) {
      return false;
    }
    const auto place = places[record.kind].find(record.id);
    if (place == places[record.kind].end()) {
      return true;  // another rank's
    }
    const std::size_t at = place->second;
    const VariableId variable = layout_.variables[at];
    if (found[at] != 0 || !Fits(record, variable, values, scale)) {
      return false;
    }
    found[at] = 1;
    ++num_found;
    std::copy_n(values, record.ambient_size, state->data() + part_.graph->StateOffset(variable));
    std::copy_n(scale, record.tangent_size, position->scale.data() + layout_.packed_offset[at]);
    return true;
  });
  // The file may hold other ids: those of landmarks and frames that only other ranks have.
  if (status.ok() && num_found != num_wanted) {
    status = Status::Error(StatusCode::kInvalidArgument,
                           path + ": has " + std::to_string(num_found) + " of the " +
                               std::to_string(num_wanted) +
                               " variables that move: a checkpoint of another problem?");
  }
  return status;
}

}  // namespace inceres::internal
