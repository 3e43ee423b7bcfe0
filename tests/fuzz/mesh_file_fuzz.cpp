// Meshes: STL binary and ascii, PLY, OBJ, STEP. The first byte of an input chooses which; the rest is the
// file.

#include "fuzz.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/mesh_topology.h"

namespace gantry::fuzz {
namespace {

constexpr char kStl = 'S', kObj = 'O', kPly = 'L', kStep = 'P';

std::string written_mesh(const std::string& name) {
  TriangleMesh tetrahedron;
  tetrahedron.vertices = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {0, 0, 10}};
  tetrahedron.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  const TemporaryFolder folder;
  write_mesh(folder / name, tetrahedron);
  return TemporaryFolder::read(folder / name);
}

const std::string kAsciiStl =
    "solid part\nfacet normal 0 0 -1\n outer loop\n  vertex 0 0 0\n  vertex 0 1e1 0\n  vertex 10 0 0\n "
    "endloop\n"
    "endfacet\nfacet normal 0 -1 0\n outer loop\n  vertex 0 0 0\n  vertex 10 0 0\n  vertex 0 0 10.5\n "
    "endloop\n"
    "endfacet\nendsolid part\n";
const std::string kObjText =
    "# by hand\nmtllib part.mtl\no part\nv 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 1e1\nvn 0 0 1\nvt 0 1\nusemtl "
    "steel\n"
    "s off\nf 1 2 3\nf 1/1/1 2/1/1 4/1/1\nf -1 -2 -4\nf 1//1 2//1 3//1 4//1\n";
const std::string kAsciiPly =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement "
    "face 2\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 2 1\n";

/// The least that has a shape to it: a triangle's worth of entities that refer to each other.
const std::string kStepText =
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
    "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"
    "#1=PRODUCT('part','part','',(#2));\n#2=PRODUCT_CONTEXT('',#3,'mechanical');\n"
    "#3=APPLICATION_CONTEXT('automotive design');\n#4=CARTESIAN_POINT('',(0.,0.,0.));\n"
    "#5=DIRECTION('',(0.,0.,1.));\n#6=AXIS2_PLACEMENT_3D('',#4,#5,$);\n#7=PLANE('',#6);\n"
    "#8=FACE_SURFACE('',(),#7,.T.);\n#9=OPEN_SHELL('',(#8));\n#10=SHELL_BASED_SURFACE_MODEL('',(#9));\n"
    "ENDSEC;\nEND-ISO-10303-21;\n";

}  // namespace

std::vector<std::string> seeds() {
  return {kStl + written_mesh("a.stl"),
          kPly + written_mesh("a.ply"),
          kStl + kAsciiStl,
          kObj + kObjText,
          kPly + kAsciiPly,
          kStep + kStepText};
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static const fuzz::InputFile stl("input.stl"), obj("input.obj"), ply("input.ply"), step("input.step");
  if (size == 0) return 0;
  const auto& file = data[0] == fuzz::kStl    ? stl
                     : data[0] == fuzz::kObj  ? obj
                     : data[0] == fuzz::kStep ? step
                                              : ply;
  const auto& path = file.write(fuzz::text_of(data + 1, size - 1));
  fuzz::value_or_input_error([&] { analyse_topology(read_mesh(path)); });
  return 0;
}
