#pragma once

#include <memory>
#include <unordered_map>

namespace inceres::internal {

/// One adapter for each distinct object of the user's; the last one is remembered, for neighbors mostly share.
template <typename Base, typename Adapter, typename Foreign>
class AdapterCache {
 public:
  /// Null for null.
  const std::shared_ptr<const Base>& Get(const Foreign* foreign) {
    if (foreign == nullptr) {
      return null_;
    }
    if (foreign != last_foreign_) {
      std::shared_ptr<const Base>& adapter = adapters_[foreign];
      if (adapter == nullptr) {
        adapter = std::make_shared<Adapter>(foreign);
      }
      last_foreign_ = foreign;
      last_ = &adapter;
    }
    return *last_;
  }

 private:
  std::unordered_map<const Foreign*, std::shared_ptr<const Base>> adapters_;
  std::shared_ptr<const Base> null_;
  const Foreign* last_foreign_ = nullptr;
  const std::shared_ptr<const Base>* last_ = nullptr;
};

}  // namespace inceres::internal
