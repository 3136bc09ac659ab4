using System;
using System.Collections.Generic;
using UnityEngine;
using UnityEngine.Rendering;

namespace Terraport.Unity
{
    /// <summary>
    /// Makes the ground that is shown solid around feet, detail and base, hidden faces not: for bodies that walk. Taken again when the feet
    /// have moved on or what is shown has changed; a bounded number of faces at a time, cooked on a thread.
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
        [Tooltip("Feet of the walking body.")]
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
        // One carries while the other is cooked; then they change places.
        private SolidMesh carrying, coming;
        // Where the newest cube is, half its side, and of which state of the ground.
        private Vec3 centre;
        private double reachM;
        private int changes = -1;

        /// <summary>Feet of the walking body.</summary>
        public Transform Feet
        {
            get => feet;
            set => feet = value;
        }

        /// <summary>Whether the ground under the feet is solid as it is shown.</summary>
        public bool IsCurrent => !coming.IsCooking && scene.Ground != null && scene.Ground.Changes == changes && !HasMovedOn;

        /// <summary>Whether the feet have left the inner half of the cube.</summary>
        private bool HasMovedOn
        {
            get {
                Vec3 away = scene.ToScene(feet.position) - centre;
                return Math.Max(Math.Max(Math.Abs(away.X), Math.Abs(away.Z)), Math.Abs(away.Y)) > reachM / 2;
            }
        }

        private void OnEnable()
        {
            scene = GetComponent<TerraportScene>();
            carrying = new SolidMesh(gameObject);
            coming = new SolidMesh(gameObject);
            changes = -1;
        }

        private void OnDisable()
        {
            carrying.Destroy();
            coming.Destroy();
        }

        private void Update()
        {
            if (coming.Step())
            {
                SolidMesh before = carrying;
                carrying = coming;
                coming = before;
                coming.Clear();
            }
            ShownGround ground = scene.Ground;
            if (coming.IsCooking || ground == null || feet == null || (ground.Changes == changes && !HasMovedOn)) return;
            changes = ground.Changes;
            centre = scene.ToScene(feet.position);
            reachM = ground.Gather(centre, halfM, maxFaces, corners);
            if (corners.Count == 0)
            {
                carrying.Clear(); // The feet are in the air.
                return;
            }
            Fill(coming.Mesh);
            coming.Cook();
        }

        private void Fill(Mesh mesh)
        {
            var vertices = new Vector3[corners.Count / 3];
            var indices = new int[vertices.Length];
            for (int at = 0; at < vertices.Length; at++)
            {
                int from = 3 * (at - at % 3 + Axes.TurnCorner(at % 3));
                vertices[at] = new Vector3(corners[from], corners[from + 1], Axes.TurnZ(corners[from + 2]));
                indices[at] = at;
            }
            mesh.Clear();
            mesh.indexFormat = IndexFormat.UInt32;
            mesh.SetVertices(vertices);
            mesh.SetIndices(indices, MeshTopology.Triangles, 0);
        }
    }
}
