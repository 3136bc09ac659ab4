namespace UnityEngine
{
    public struct RaycastHit
    {
        public Vector3 point { get; set; }
    }

    public struct LayerMask
    {
        public int value { get; set; }
    }

    public class Collider : Component
    {
        public bool enabled { get; set; }
    }

    public class MeshCollider : Collider
    {
        public Mesh sharedMesh { get; set; }
    }

    public class Physics
    {
        public static bool Raycast(Ray ray, out RaycastHit hitInfo, float maxDistance, int layerMask)
        {
            hitInfo = default(RaycastHit);
            return (StubWallLayers & layerMask) != 0 && StubWallAtM < maxDistance;
        }

        /// <summary>A wall that every ray meets after so many metres, on these layers.</summary>
        [StubsOwn]
        public static float StubWallAtM { get; set; }

        [StubsOwn]
        public static int StubWallLayers { get; set; }

#if UNITY_6000_5_OR_NEWER
        [System.Obsolete("EntityId", true)]
#elif UNITY_6000_3_OR_NEWER
        [System.Obsolete("EntityId")]
#endif
        public static void BakeMesh(int meshID, bool convex)
        {
        }

#if UNITY_6000_3_OR_NEWER
        public static void BakeMesh(EntityId meshID, bool convex) {}
#endif
    }
}
