namespace UnityEngine
{
    public struct RaycastHit
    {
        public Vector3 point { get; set; }
    }

    public class Collider : Component
    {
    }

    public class MeshCollider : Collider
    {
        public Mesh sharedMesh { get; set; }
    }

    public class Physics
    {
        public static bool Raycast(Ray ray, out RaycastHit hitInfo, float maxDistance)
        {
            hitInfo = default(RaycastHit);
            return false;
        }

        public static void BakeMesh(int meshID, bool convex)
        {
        }
    }
}
