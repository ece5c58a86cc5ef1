// Writes C code of a robot's inverse dynamics by way of CppADCodeGen: usage generate MODEL FOLDER
#include <pinocchio/codegen/cppadcg.hpp>
// cppadcg.hpp comes first: it teaches Pinocchio the scalar type.
#include <pinocchio/codegen/cppadcg-algo.hpp>

#include <pinocchio/algorithm/rnea.hpp>

#include "pinocchio_model.hpp"

struct Rnea : pin::CodeGenRNEA<double> {
  using pin::CodeGenRNEA<double>::CodeGenRNEA;
  void save(const std::string& folder) {
    build_jacobian = false;
    initLib();
    CppAD::cg::SaveFilesModelLibraryProcessor<double> files(*libcgen_ptr);
    files.saveSourcesTo(folder);
  }
};

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  pin::Model model = read_model(argv[1]);
  model.frames.resize(1);
  Rnea(model, "rnea", "library").save(argv[2]);
}
