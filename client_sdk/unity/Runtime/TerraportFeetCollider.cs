using System.Collections.Generic;
using System.Threading.Tasks;
using UnityEngine;
using UnityEngine.Rendering;

namespace Terraport.Unity
{
    /// <summary>
    /// Makes the ground that is shown solid around somebody's feet, detail and base, hidden faces not: for bodies that walk. Taken anew
    /// when the feet have moved on or what is shown has changed; a bounded number of faces a time, cooked on a thread.
    /// </summary>
    /// <remarks>
    /// Where a <see cref="TerraportGroundCollider"/> is solid as well, the higher of the two carries: give that one a layer which the
    /// body does not meet, or leave it away.
    /// </remarks>
    [AddComponentMenu("Terraport/Terraport Feet Collider")]
    [RequireComponent(typeof(TerraportScene))]
    public sealed class TerraportFeetCollider : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("Whose feet: the walking body.")]
        private Transform feet;

        [SerializeField]
        [Range(1, 50)]
        [Tooltip("Half the side of the cube that is solid around the feet, metres. More: cooked less often, and longer.")]
        private float halfM = 4;

        [SerializeField]
        [Range(256, 65536)]
        [Tooltip("Faces that are solid at most; where there are more the cube is halved.")]
        private int maxFaces = 8192;

        // Scene frame, three corners a face.
        private readonly List<float> corners = new List<float>();
        private TerraportScene scene;
        private MeshCollider solid;
        // One carries while the other is cooked; then they change places.
        private Mesh carrying;
        private Mesh cooked;
        private Task cooking;
        // Where the newest cube is, its half side, and of which state of the ground.
        private Vec3 centre;
        private double reachM;
        private int changes = -1;

        /// <summary>Whose feet.</summary>
        public Transform Feet
        {
            get {
                return feet;
            }
            set {
                feet = value;
            }
        }

        /// <summary>Whether the ground under the feet is solid as it is shown.</summary>
        public bool IsCurrent => cooking == null && scene.Ground != null && scene.Ground.Changes == changes && !HasMovedOn();

        private void OnEnable()
        {
            scene = GetComponent<TerraportScene>();
            carrying = NewMesh();
            cooked = NewMesh();
            solid = gameObject.AddComponent<MeshCollider>();
            solid.hideFlags = HideFlags.DontSave;
            changes = -1;
        }

        private void OnDisable()
        {
            if (cooking != null)
            {
                // A mesh must not go while a thread reads it; some milliseconds.
                Task.WaitAny(cooking);
                cooking = null;
            }
            Engine.Destroy(solid);
            Engine.Destroy(carrying);
            Engine.Destroy(cooked);
        }

        private void Update()
        {
            if (cooking != null)
            {
                if (!cooking.IsCompleted)
                {
                    return;
                }
                cooking = null;
                Carry();
            }
            ShownGround ground = scene.Ground;
            if (ground != null && feet != null && (ground.Changes != changes || HasMovedOn()))
            {
                changes = ground.Changes;
                centre = scene.ToScene(feet.position);
                reachM = ground.Gather(centre, halfM, maxFaces, corners);
                Cook();
            }
        }

        /// <summary>Whether the feet have left the inner half of the cube.</summary>
        private bool HasMovedOn()
        {
            Vec3 at = scene.ToScene(feet.position);
            double away = System.Math.Max(System.Math.Abs(at.X - centre.X), System.Math.Abs(at.Z - centre.Z));
            return System.Math.Max(away, System.Math.Abs(at.Y - centre.Y)) > reachM / 2;
        }

        private void Cook()
        {
            Fill(cooked);
            if (corners.Count == 0)
            {
                solid.sharedMesh = null; // Nothing is there: the feet are in the air.
                return;
            }
#if UNITY_6000_3_OR_NEWER
            EntityId id = cooked.GetEntityId();
#else
            int id = cooked.GetInstanceID();
#endif
            if (Platform.HasThreads)
            {
                cooking = Task.Run(() => Physics.BakeMesh(id, false));
            }
            else
            {
                Physics.BakeMesh(id, false);
                Carry();
            }
        }

        private void Carry()
        {
            // Cooked already, so this only takes the result over.
            solid.sharedMesh = cooked;
            Mesh before = carrying;
            carrying = cooked;
            cooked = before;
        }

        private void Fill(Mesh mesh)
        {
            Vector3[] vertices = new Vector3[corners.Count / 3];
            int[] indices = new int[vertices.Length];
            for (int at = 0; at < vertices.Length; at++)
            {
                // Turned, a face's corners run the other way round: the second and third change places.
                int from = at % 3 == 0 ? at : at % 3 == 1 ? at + 1 : at - 1;
                vertices[at] = new Vector3(corners[from * 3], corners[from * 3 + 1], Axes.TurnZ(corners[from * 3 + 2]));
                indices[at] = at;
            }
            mesh.Clear();
            mesh.indexFormat = IndexFormat.UInt32;
            mesh.SetVertices(vertices);
            mesh.SetIndices(indices, MeshTopology.Triangles, 0);
        }

        private static Mesh NewMesh()
        {
            Mesh mesh = new Mesh();
            mesh.name = "terraport feet";
            mesh.hideFlags = HideFlags.DontSave;
            return mesh;
        }
    }
}
