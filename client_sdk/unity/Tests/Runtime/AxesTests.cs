using NUnit.Framework;
using Terraport.Unity;

namespace Terraport.Tests
{
    /// <summary>The scene's frame becomes Unity's: east stays X, up stays Y, south becomes -Z, triangles and V turn round.</summary>
    [TestFixture]
    public class AxesTests
    {
        [Test]
        public void EastIsXUpIsYAndNorthIsZ()
        {
            Assert.AreEqual(new Vec3(1, 0, 0), Axes.Turn(new Vec3(1, 0, 0)), "east");
            Assert.AreEqual(new Vec3(0, 1, 0), Axes.Turn(new Vec3(0, 1, 0)), "up");
            Vec3 north = Axes.Turn(new Vec3(0, 0, -1));
            Assert.AreEqual(1.0, north.Z, "north");
        }

        [Test]
        public void TurningTwiceChangesNothing()
        {
            Vec3 position = new Vec3(12.5, -3, 40.25);
            Assert.AreEqual(position, Axes.Turn(Axes.Turn(position)));
            Box box = new Box(1, 2, 3, 4, 5, 6);
            Assert.AreEqual(new Box(1, 2, -6, 4, 5, -3), Axes.Turn(box));
            Assert.AreEqual(box, Axes.Turn(Axes.Turn(box)));
        }

        [Test]
        public void CodesBecomeExactMetres()
        {
            // 2^-12 m steps, 4 km from the origin: the last bit of float32.
            float step = 1f / 4096;
            float[] metres = new float[6];
            Axes.Positions(new ushort[] { 0, 1, 2, 9, 65535, 65535, 65535, 9 }, 2, 4000, -8, -4000, step, metres);
            Assert.AreEqual(
                new[] { 4000f, -8f + step, 4000f - 2 * step, 4000f + 65535 * step, -8f + 65535 * step, 4000f - 65535 * step }, metres);
        }

        [Test]
        public void FacesSeenFromOutsideTurnClockwise()
        {
            // Level ground, seen from above counter-clockwise in the scene: east, then north.
            float[] scene = { 0, 0, 0, 1, 0, 0, 0, 0, -1 };
            float[] unity = new float[9];
            uint[] indices = { 0, 1, 2 };
            Axes.Positions(scene, 3, unity);
            Axes.Indices(indices, 1, indices);
            Assert.AreEqual(new uint[] { 0, 2, 1 }, indices);
            // Unity's front is where the component-wise cross product points: up.
            Assert.Greater(CrossY(unity, indices), 0);
        }

        [Test]
        public void NormalsKeepTheirRange()
        {
            sbyte[] normals = { 1, 2, -128, 7, -127, 0, 127, 7 };
            Axes.Normals(normals, 2, normals);
            Assert.AreEqual(new sbyte[] { 1, 2, 127, 0, -127, 0, -127, 0 }, normals);
        }

        [Test]
        public void VCountsFromTheLowerEdge()
        {
            float[] uvs = new float[4];
            Axes.Uvs(new ushort[] { 0, 0, 512, 128 }, 2, 1f / 512, 1f / 256, uvs);
            Assert.AreEqual(new[] { 0f, 1f, 1f, 0.5f }, uvs);
            Axes.Uvs(new[] { 0.25f, 0.75f }, 1, uvs);
            Assert.AreEqual(0.25f, uvs[0]);
            Assert.AreEqual(0.25f, uvs[1]);
        }

        private static float CrossY(float[] positions, uint[] face)
        {
            float ax = positions[face[1] * 3] - positions[face[0] * 3];
            float az = positions[face[1] * 3 + 2] - positions[face[0] * 3 + 2];
            float bx = positions[face[2] * 3] - positions[face[0] * 3];
            float bz = positions[face[2] * 3 + 2] - positions[face[0] * 3 + 2];
            return az * bx - ax * bz;
        }
    }
}
