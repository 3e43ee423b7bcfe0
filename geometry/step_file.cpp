// STEP by OpenCASCADE: ISO 10303-21 files of AP203, AP214 and AP242. Only built where it is installed.

#include "step_file.h"

#include <BRepMesh_IncrementalMesh.hxx>
#include <BRep_Tool.hxx>
#include <Interface_Static.hxx>
#include <Poly_Triangulation.hxx>
#include <STEPControl_Reader.hxx>
#include <Standard_Failure.hxx>
#include <Standard_Version.hxx>
#include <TColStd_SequenceOfAsciiString.hxx>
#include <TCollection_AsciiString.hxx>
#include <TopExp_Explorer.hxx>
#include <TopLoc_Location.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Shape.hxx>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <gp_Pnt.hxx>
#include <gp_Trsf.hxx>
#include <numbers>
#include <stdexcept>

#include "gantry/foundation/error.h"
#include "isolated.h"

namespace gantry {
namespace {

constexpr double kPatience_s = 600;  ///< Assemblies of many megabytes take minutes.

void append_face(TriangleMesh& soup, const TopoDS_Face& face) {
  TopLoc_Location location;
  const Handle(Poly_Triangulation) part = BRep_Tool::Triangulation(face, location);
  if (part.IsNull()) throw std::runtime_error("one of its faces cannot be cut into triangles");
  const gp_Trsf& file_from_face = location.Transformation();
  // A mirrored copy turns its triangles round, as a face that is used from behind does.
  const bool turned = (face.Orientation() == TopAbs_REVERSED) != file_from_face.IsNegative();
  const auto first = static_cast<int>(soup.vertices.size());
  for (int i = 1; i <= part->NbNodes(); ++i) {
    const gp_Pnt p = part->Node(i).Transformed(file_from_face);
    soup.vertices.emplace_back(static_cast<float>(p.X()), static_cast<float>(p.Y()),
                               static_cast<float>(p.Z()));
  }
  for (int i = 1; i <= part->NbTriangles(); ++i) {
    int a = 0, b = 0, c = 0;
    part->Triangle(i).Get(a, b, c);
    if (turned) std::swap(b, c);
    soup.triangles.emplace_back(first + a - 1, first + b - 1, first + c - 1);
  }
}

std::string units_of(STEPControl_Reader& reader) {
  TColStd_SequenceOfAsciiString lengths, angles, solid_angles;
  reader.FileUnits(lengths, angles, solid_angles);
  std::string units;
  for (int i = 1; i <= lengths.Length(); ++i) {
    const std::string unit = lengths.Value(i).ToCString();
    if (!unit.empty() && units.find(unit) == std::string::npos) units += (units.empty() ? "" : ", ") + unit;
  }
  return units.empty() ? "no unit stated" : units;
}

/// Runs in the copy of this process.
TriangleMesh tessellate(const std::string& path, const TessellationOptions& options, std::string& unit) {
  try {
    STEPControl_Reader reader;
    Interface_Static::SetCVal("xstep.cascade.unit", "MM");  // what the file's own unit is converted to
    if (reader.ReadFile(path.c_str()) != IFSelect_RetDone)
      throw std::runtime_error("not a readable STEP file");
    unit = units_of(reader);
    if (reader.TransferRoots() < 1) throw std::runtime_error("holds no part (STEP without a product shape)");
    const TopoDS_Shape shape = reader.OneShape();
    if (shape.IsNull()) throw std::runtime_error("holds no shape");
    const BRepMesh_IncrementalMesh mesher(shape, options.chord_mm, Standard_False, options.angle_rad,
                                          Standard_False);
    TriangleMesh soup;
    for (TopExp_Explorer faces(shape, TopAbs_FACE); faces.More(); faces.Next())
      append_face(soup, TopoDS::Face(faces.Current()));
    return soup;
  } catch (const Standard_Failure& failure) {  // no std::exception in 7.6
    const char* message = failure.GetMessageString();
    throw std::runtime_error(std::string("not a readable STEP file: ") +
                             (message ? message : "unknown error"));
  }
}

template <typename T>
void append(std::string& bytes, const T* values, size_t count) {
  bytes.append(reinterpret_cast<const char*>(values), count * sizeof(T));
}

template <typename T>
void take(const std::string& bytes, size_t& at, T* values, size_t count) {
  if (count > (bytes.size() - at) / sizeof(T))
    throw InputError("the answer of the STEP reader was cut short");
  if (count > 0) std::memcpy(static_cast<void*>(values), bytes.data() + at, count * sizeof(T));
  at += count * sizeof(T);
}

}  // namespace

namespace internal {

TriangleMesh read_step(const std::filesystem::path& path, const TessellationOptions& options,
                       std::string& tessellation) {
  const std::string name = path.string();
  if (!(options.chord_mm > 0) || !std::isfinite(options.chord_mm))
    throw InputError("tessellation: the chord must be a positive length");
  if (!(options.angle_rad > 0 && options.angle_rad <= std::numbers::pi / 2))
    throw InputError("tessellation: the angle must lie between 0 and 90 degrees");
  const std::string bytes = run_isolated(
      [&] {
        std::string unit;
        const TriangleMesh soup = tessellate(name, options, unit);
        std::string answer;
        const uint64_t sizes[3] = {unit.size(), soup.vertices.size(), soup.triangles.size()};
        append(answer, sizes, 3);
        append(answer, unit.data(), unit.size());
        append(answer, soup.vertices.data(), soup.vertices.size());
        append(answer, soup.triangles.data(), soup.triangles.size());
        return answer;
      },
      kPatience_s, name);
  size_t at = 0;
  uint64_t sizes[3] = {};
  take(bytes, at, sizes, 3);
  // Nothing larger than the answer itself is set aside.
  if (sizes[0] > bytes.size() || sizes[1] > bytes.size() || sizes[2] > bytes.size())
    throw InputError(name + ": the answer of the STEP reader was cut short");
  std::string unit(sizes[0], '\0');
  TriangleMesh soup;
  soup.vertices.resize(sizes[1]);
  soup.triangles.resize(sizes[2]);
  take(bytes, at, unit.data(), unit.size());
  take(bytes, at, soup.vertices.data(), soup.vertices.size());
  take(bytes, at, soup.triangles.data(), soup.triangles.size());
  char text[200];
  std::snprintf(text, sizeof text, "STEP in %.60s, cut into triangles within %.4g mm and %.3g degrees",
                unit.c_str(), options.chord_mm, options.angle_rad * 180 / std::numbers::pi);
  tessellation = text;
  return soup;
}

}  // namespace internal

std::string step_support() {
  return "read by OpenCASCADE " OCC_VERSION_COMPLETE;
}
bool reads_step() {
  return true;
}

}  // namespace gantry
