using System.Collections.Generic;
using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// Makes the base of a scene solid for rays and bodies: pointers of the XR Interaction Toolkit and Physics.Raycast meet it. Cooked
    /// on a thread, a block at a time; nothing is solid before.
    /// </summary>
    /// <remarks>
    /// The base is solid, hidden faces too, and not the detail, which is at most the scene's deviation away from it nearly everywhere: ask
    /// <see cref="TerraportScene.GroundAt"/> for the height to stand on.
    /// </remarks>
    [AddComponentMenu("Terraport/Terraport Ground Collider")]
    [RequireComponent(typeof(TerraportScene))]
    [DisallowMultipleComponent]
    public sealed class TerraportGroundCollider : MonoBehaviour
    {
        private readonly List<SolidMesh> solids = new List<SolidMesh>();
        // Of the version before: solid until the new ground is, or a body on it would fall through.
        private readonly List<SolidMesh> leaving = new List<SolidMesh>();
        private TerraportScene scene;
        private SceneFiles files;
        private Task<PackedBase> packing;
        private PackedBase packed;

        /// <summary>Whether all of the base is solid.</summary>
        public bool IsComplete => packed != null && solids.Count == packed.Blocks.Count && !IsCooking && leaving.Count == 0;

        private bool IsCooking => solids.Count > 0 && solids[solids.Count - 1].IsCooking;

        private void OnEnable()
        {
            scene = GetComponent<TerraportScene>();
            scene.Loaded += OnLoaded;
            if (scene.Files != null) OnLoaded(scene.Files);
        }

        private void OnDisable()
        {
            scene.Loaded -= OnLoaded;
            Clear();
        }

        private void OnLoaded(SceneFiles loaded)
        {
            leaving.AddRange(solids);
            solids.Clear();
            files = loaded;
            packed = null;
            packing = Platform.HasThreads ? Task.Run(() => new PackedBase(loaded.Base)) : Task.FromResult(new PackedBase(loaded.Base));
        }

        private void Update()
        {
            // It was closed: what is not drawn is not solid either.
            if (files != null && scene.Files == null) Clear();
            if (packing != null && packing.IsCompleted)
            {
                packed = packing.Result;
                packing = null;
            }
            if (IsCooking) solids[solids.Count - 1].Step();
            if (packed == null || IsCooking) return;
            if (solids.Count < packed.Blocks.Count)
            {
                var solid = new SolidMesh(gameObject);
                MeshFiller.Fill(solid.Mesh, packed.Blocks[solids.Count]);
                packed.Blocks[solids.Count].DropVertices();
                solids.Add(solid);
                solid.Cook();
            }
            else if (leaving.Count > 0)
            {
                leaving.ForEach(solid => solid.Destroy());
                leaving.Clear();
            }
        }

        private void Clear()
        {
            files = null;
            packing = null;
            packed = null;
            solids.ForEach(solid => solid.Destroy());
            leaving.ForEach(solid => solid.Destroy());
            solids.Clear();
            leaving.Clear();
        }
    }
}
