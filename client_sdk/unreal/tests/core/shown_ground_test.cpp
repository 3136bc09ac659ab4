#include <doctest/doctest.h>

#include <cmath>
#include <random>

#include "GroundMesh.h"
#include "Terraport/ShownGround.h"

namespace terraport_tests {
namespace {

using terraport::GroundPoint;
using terraport::SegmentMesh;
using terraport::Vec3;

/// A sheet of `side` x `side` squares of 1 m at a height, with hills of 0.8 m where it is hilly.
void makeSheet(SegmentMesh& mesh, std::uint32_t side, float heightM, bool isHilly) {
  mesh.positionForm = terraport::VertexForm::Floats;
  mesh.vertexCount = (side + 1) * (side + 1);
  mesh.faceCount = 2 * side * side;
  REQUIRE(mesh.positions.resize(std::size_t{3} * mesh.vertexCount));
  REQUIRE(mesh.indices.resize(std::size_t{3} * mesh.faceCount));
  for (std::uint32_t vertex = 0; vertex < mesh.vertexCount; ++vertex) {
    const auto x = static_cast<float>(vertex % (side + 1));
    const auto z = static_cast<float>(vertex / (side + 1));
    mesh.positions.data()[3 * vertex] = x;
    mesh.positions.data()[3 * vertex + 1] = heightM + (isHilly ? 0.8F * std::sin(0.7F * x) * std::cos(0.4F * z) : 0.0F);
    mesh.positions.data()[3 * vertex + 2] = z;
  }
  std::uint32_t* next = mesh.indices.data();
  for (std::uint32_t square = 0; square < side * side; ++square) {
    const std::uint32_t a = square / side * (side + 1) + square % side;
    const std::uint32_t c = a + side + 1;
    for (const std::uint32_t corner : {a, c, a + 1, a + 1, c, c + 1}) {
      *next++ = corner;
    }
  }
}

/// Draws nothing; its base is ready when the test says so.
class SlowBase final : public terraport::SceneRenderer {
 public:
  terraport::UploadState upload(std::uint32_t, const SegmentMesh&, terraport::ByteSpan) override {
    return terraport::UploadState::Done;
  }
  void free(std::uint32_t) override {}
  void beginBase(const terraport::SceneFiles&) override { isReady = false; }
  void prepareBase(const terraport::FaceRange&, const terraport::HiddenFaces&) override {}
  bool isBaseReady() override { return isReady; }
  void swap(const terraport::SceneSwap&) override {}

  bool isReady = false;
};

const Vec3 kDown{0.0, -1.0, 0.0};

}  // namespace

TEST_CASE("boxes change nothing of what rays meet") {
  SegmentMesh hills;
  makeSheet(hills, 24, 0.0F, true);
  const terraport::GroundMesh ground(hills);
  // 1. The reference: each face alone, with no box to be wrong about but its own.
  std::vector<terraport::GroundMesh> faces;
  SegmentMesh face;
  face.positionForm = terraport::VertexForm::Floats;
  face.vertexCount = 3;
  face.faceCount = 1;
  REQUIRE(face.positions.resize(9));
  REQUIRE(face.indices.resize(3));
  for (std::size_t at = 0; at < hills.indices.size(); at += 3) {
    for (std::size_t corner = 0; corner < 3; ++corner) {
      face.indices.data()[corner] = static_cast<std::uint32_t>(corner);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        face.positions.data()[3 * corner + axis] = hills.positions.data()[3 * hills.indices.data()[at + corner] + axis];
      }
    }
    faces.emplace_back(face);
  }
  // 2. Rays from above, below and the side: the nearest point of all faces is the mesh's, to the bit.
  std::mt19937 random(7);
  std::uniform_real_distribution<double> coordinate(-2.0, 26.0);
  std::uniform_real_distribution<double> slope(-1.0, 1.0);
  int metCount = 0;
  for (int ray = 0; ray < 400; ++ray) {
    const Vec3 origin{coordinate(random), 4.0 * slope(random), coordinate(random)};
    const Vec3 direction{slope(random), 0.3 * slope(random), slope(random)};
    GroundPoint nearest;
    GroundPoint point;
    nearest.at = point.at = 40.0;
    bool isAny = false;
    for (const terraport::GroundMesh& one : faces) {
      isAny = one.cast(origin, direction, nullptr, nearest) || isAny;
    }
    CHECK(ground.cast(origin, direction, nullptr, point) == isAny);
    CHECK(point.at == nearest.at);
    metCount += isAny ? 1 : 0;
  }
  CHECK(metCount > 50);
}

TEST_CASE("rays meet what is shown, from the swap on and not before") {
  SlowBase renderer;
  terraport::ShownGround ground(renderer);
  terraport::SceneFiles files;
  files.manifest.segmentCount = 10;
  makeSheet(files.base, 12, 0.0F, false);
  SegmentMesh detail;
  makeSheet(detail, 4, 0.25F, false);
  GroundPoint point;
  const Vec3 above{2.3, 5.0, 1.6};

  // 1. A base that is not drawn yet is not there.
  ground.beginBase(files);
  CHECK_FALSE(ground.isBaseReady());
  CHECK_FALSE(ground.groundAt(above, point));
  renderer.isReady = true;
  CHECK(ground.isBaseReady());
  REQUIRE(ground.groundAt(above, point));
  CHECK(point.position.y == 0.0);
  CHECK(point.segment == -1);
  CHECK(point.normal.y == 1.0);

  // 2. Detail, here segment 3 at its coarser level, is there with the swap, and the base's hidden faces go with it.
  CHECK(ground.upload(13, detail, {}) == terraport::UploadState::Done);
  REQUIRE(ground.groundAt(above, point));
  CHECK(point.segment == -1);
  std::vector<std::uint8_t> hidden(files.base.faceCount, 1);
  terraport::SceneSwap swap;
  swap.shown = {13};
  swap.baseHidden = {hidden.data(), files.base.faceCount};
  ground.swap(swap);
  hidden.assign(hidden.size(), 0);  // The stage's counters go on to the next landing.
  REQUIRE(ground.groundAt(above, point));
  CHECK(point.position.y == 0.25);
  CHECK(point.segment == 3);
  CHECK_FALSE(ground.cast({8.0, 5.0, 8.0}, kDown, 100.0, point));
  CHECK_FALSE(ground.cast(above, kDown, 4.7, point));
  // From below: the lowest above.
  REQUIRE(ground.groundAt({2.3, -3.0, 1.6}, point));
  CHECK(point.position.y == 0.25);

  // 3. What is solid around a place: its faces, no hidden one, never more than may be.
  std::vector<float> corners;
  CHECK(ground.gather({2.3, 0.25, 1.6}, 8.0, 100, corners) == 8.0);
  CHECK(corners.size() == 9 * 32);
  CHECK(ground.gather({2.3, 0.25, 1.6}, 8.0, 20, corners) == 1.0);
  CHECK(corners.size() == 9 * 18);
  CHECK(ground.gather({2.3, 9.0, 1.6}, 2.0, 100, corners) == 2.0);
  CHECK(corners.empty());
  CHECK(ground.gather({2.3, 0.25, 1.6}, 8.0, 1, corners) == 0.0);
  CHECK(corners.empty());
  CHECK(ground.changes() == 2);

  // 4. A new version: what is shown stays until the new base is drawn, and goes then.
  ground.beginBase(files);
  renderer.isReady = false;
  REQUIRE(ground.groundAt(above, point));
  CHECK(point.segment == 3);
  CHECK_FALSE(ground.isBaseReady());
  renderer.isReady = true;
  CHECK(ground.isBaseReady());
  REQUIRE(ground.groundAt(above, point));
  CHECK(point.segment == -1);
}

}  // namespace terraport_tests
