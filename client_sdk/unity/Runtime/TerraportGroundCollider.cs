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
    /// It is the base that is solid, hidden faces too, and not the detail, which stands at most the scene's deviation from it nearly
    /// everywhere: ask <see cref="TerraportScene.GroundAt"/> for the height to stand on.
    /// </remarks>
    [AddComponentMenu("Terraport/Terraport Ground Collider")]
    [RequireComponent(typeof(TerraportScene))]
    [DisallowMultipleComponent]
    public sealed class TerraportGroundCollider : MonoBehaviour
    {
        private const int BlockFaces = 16384;

        private readonly List<Mesh> meshes = new List<Mesh>();
        private readonly List<MeshCollider> colliders = new List<MeshCollider>();
        // Of the version before: solid until the new ground is, or whoever stands on it would fall through.
        private readonly List<Mesh> leavingMeshes = new List<Mesh>();
        private readonly List<MeshCollider> leavingColliders = new List<MeshCollider>();
        private TerraportScene scene;
        private SceneFiles files;
        // One block at a time: packed (packing), cooked on a thread (cooking), then added as a collider on the main thread.
        private Task<BaseBlocks> packing;
        private BaseBlocks blocks;
        private Task cooking;

        /// <summary>Whether all of the base is solid.</summary>
        public bool IsComplete => blocks != null && colliders.Count == blocks.Count && leavingColliders.Count == 0;

        private void OnEnable()
        {
            scene = GetComponent<TerraportScene>();
            scene.Loaded += OnLoaded;
            if (scene.Files != null)
            {
                OnLoaded(scene.Files);
            }
        }

        private void OnDisable()
        {
            scene.Loaded -= OnLoaded;
            Clear();
        }

        private void Update()
        {
            if (files != null && scene.Files == null)
            {
                Clear(); // It was closed: what is not drawn is not solid either.
                return;
            }
            // 1. The pack, whole, from its thread.
            if (packing != null && packing.IsCompleted)
            {
                if (packing.IsFaulted)
                {
                    Debug.LogWarning("terraport: no solid ground: " + packing.Exception.GetBaseException().Message, this);
                }
                blocks = packing.IsFaulted ? null : packing.Result;
                packing = null;
            }
            // 2. The block that is being cooked; a mesh may not be touched meanwhile.
            if (cooking != null && !cooking.IsCompleted)
            {
                return;
            }
            if (cooking != null)
            {
                cooking = null;
                AddCollider(meshes[meshes.Count - 1]);
            }
            // 3. The next block; without threads it is packed in this frame first.
            if (blocks != null && meshes.Count < blocks.Count
                && (Platform.HasThreads || blocks.Step() || blocks.PackedCount > meshes.Count))
            {
                BeginCooking();
            }
            // 4. All solid: the version before can go.
            if (blocks != null && colliders.Count == blocks.Count && leavingColliders.Count > 0)
            {
                DestroyAll(leavingColliders, leavingMeshes);
            }
        }

        private void OnLoaded(SceneFiles loaded)
        {
            StopCooking();
            leavingColliders.AddRange(colliders);
            leavingMeshes.AddRange(meshes);
            colliders.Clear();
            meshes.Clear();
            files = loaded;
            BaseBlocks unpacked = new BaseBlocks(files.Base, BlockFaces);
            if (!Platform.HasThreads)
            {
                blocks = unpacked;
                return;
            }
            packing = Task.Run(() =>
                {
                    while (unpacked.Step())
                    {
                    }
                    return unpacked;
                });
        }

        private void BeginCooking()
        {
            Mesh mesh = new Mesh();
            mesh.name = "terraport collider";
            mesh.hideFlags = HideFlags.DontSave;
            MeshFiller.Fill(mesh, blocks.PackedOf(meshes.Count));
            meshes.Add(mesh);
            // A mesh is named to other threads by its number: 32 bits once, an EntityId from Unity 6.3 on (from 6.5 on nothing else compiles).
#if UNITY_6000_3_OR_NEWER
            EntityId id = mesh.GetEntityId();
#else
            int id = mesh.GetInstanceID();
#endif
            if (Platform.HasThreads)
            {
                cooking = Task.Run(() => Physics.BakeMesh(id, false));
            }
            else
            {
                Physics.BakeMesh(id, false);
                AddCollider(mesh);
            }
        }

        private void AddCollider(Mesh mesh)
        {
            MeshCollider solid = gameObject.AddComponent<MeshCollider>();
            solid.hideFlags = HideFlags.DontSave;
            // Cooked already, so this only takes the result over.
            solid.sharedMesh = mesh;
            colliders.Add(solid);
        }

        private void StopCooking()
        {
            if (cooking != null)
            {
                // A mesh must not go while a thread reads it; one block takes some tens of milliseconds.
                Task.WaitAny(cooking);
                cooking = null;
            }
            packing = null;
            blocks = null;
        }

        private void Clear()
        {
            StopCooking();
            files = null;
            DestroyAll(colliders, meshes);
            DestroyAll(leavingColliders, leavingMeshes);
        }

        private static void DestroyAll(List<MeshCollider> solids, List<Mesh> shapes)
        {
            foreach (MeshCollider solid in solids)
            {
                Engine.Destroy(solid);
            }
            solids.Clear();
            foreach (Mesh shape in shapes)
            {
                Engine.Destroy(shape);
            }
            shapes.Clear();
        }
    }
}
