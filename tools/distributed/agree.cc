#include "tools/distributed/agree.h"

#include <string>

namespace inceres::tools {

Status Agree(MPI_Comm comm, const Status& own) {
  int rank = 0;
  int size = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  int failed = own.ok() ? size : rank;
  MPI_Allreduce(MPI_IN_PLACE, &failed, 1, MPI_INT, MPI_MIN, comm);
  if (failed == size) {
    return Status::Ok();
  }
  int said[2] = {static_cast<int>(own.code), static_cast<int>(own.message.size())};
  MPI_Bcast(said, 2, MPI_INT, failed, comm);
  std::string message = own.message;
  message.resize(static_cast<std::size_t>(said[1]));
  MPI_Bcast(message.data(), said[1], MPI_CHAR, failed, comm);
  return Status::Error(static_cast<StatusCode>(said[0]), message);
}

}  // namespace inceres::tools
