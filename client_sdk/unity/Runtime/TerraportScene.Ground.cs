using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>The ground under feet and pointers: of what is shown, detail and base, without colliders.</summary>
    public sealed partial class TerraportScene
    {
        /// <summary>
        /// Landings and aims ask for a ring of the coarser level around full detail, where the scene has one; may be changed at any time,
        /// and counts from the next of them on.
        /// </summary>
        public bool ShowsCoarse
        {
            get {
                return settings.showsCoarse;
            }
            set {
                settings.showsCoarse = value;
                if (session != null && session.Stage != null)
                {
                    session.Stage.ShowsCoarse = value;
                }
            }
        }

        /// <summary>What is shown, scene frame; null while the scene is closed.</summary>
        public ShownGround Ground => session == null ? null : session.Ground;

        /// <summary>The first point of what is shown along a ray of Unity's world. Exact; a fraction of a millisecond.</summary>
        public bool CastGround(Ray ray, float reachM, out GroundHit hit)
        {
            GroundPoint point = default(GroundPoint);
            // As a vector, with the scale: then the point counts in lengths of the world's ray.
            Vector3 along = transform.InverseTransformVector(ray.direction);
            bool isMet = session != null
                && session.Ground.Cast(ToScene(ray.origin), Axes.Turn(new Vec3(along.x, along.y, along.z)), reachM, out point);
            hit = isMet ? HitOf(point) : default(GroundHit);
            return isMet;
        }

        /// <summary>Ground of what is shown on the vertical through a point: the highest not above it, else the lowest above it.</summary>
        /// <remarks>For feet ask from the knee: who stands on a step would else fall through what rises before them.</remarks>
        public bool GroundAt(Vector3 place, out GroundHit hit)
        {
            GroundPoint point = default(GroundPoint);
            bool isMet = session != null && session.Ground.At(ToScene(place), out point);
            hit = isMet ? HitOf(point) : default(GroundHit);
            return isMet;
        }

        private GroundHit HitOf(GroundPoint point)
        {
            GroundHit hit = default(GroundHit);
            hit.Point = ToWorld(point.Position);
            Vec3 above = new Vec3(point.Position.X + point.Normal.X, point.Position.Y + point.Normal.Y, point.Position.Z + point.Normal.Z);
            hit.Normal = ToWorld(above) - hit.Point;
            hit.Distance = (float)point.At;
            hit.Segment = point.Segment;
            return hit;
        }
    }
}
