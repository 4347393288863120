#include "module.h"

PYBIND11_MODULE(_core, module) {
  module.doc() = "The core of inceres. Use it as `import inceres`.";
  inceres::python::BindLosses(module);
  inceres::python::BindManifolds(module);
  inceres::python::BindFamilies(module);
  inceres::python::BindOptions(module);
  inceres::python::BindGraph(module);
  inceres::python::BindIncremental(module);
  inceres::python::BindFiles(module);
}
