using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>A mesh that becomes solid: cooked on a thread where there are threads, then taken over by a collider.</summary>
    internal sealed class SolidMesh
    {
        private readonly MeshCollider collider;
        private Task cooking;

        internal SolidMesh(GameObject holder)
        {
            Mesh = new Mesh { name = "terraport collider", hideFlags = HideFlags.DontSave };
            collider = holder.AddComponent<MeshCollider>();
            collider.hideFlags = HideFlags.DontSave;
        }

        /// <summary>To be filled before <see cref="Cook"/>, and not changed while it is cooked.</summary>
        internal Mesh Mesh { get; }

        internal bool IsCooking => cooking != null;

        /// <summary>Begin; <see cref="Step"/> ends it.</summary>
        internal void Cook()
        {
#if UNITY_6000_3_OR_NEWER
            EntityId id = Mesh.GetEntityId();
#else
            int id = Mesh.GetInstanceID();
#endif
            if (Platform.HasThreads)
            {
                cooking = Task.Run(() => Physics.BakeMesh(id, false));
                return;
            }
            Physics.BakeMesh(id, false);
            cooking = Task.CompletedTask;
        }

        /// <summary>Once per frame: make it solid when it is cooked. True in that frame.</summary>
        internal bool Step()
        {
            if (cooking == null || !cooking.IsCompleted) return false;
            cooking = null;
            // Cooked already: this only takes the result over.
            collider.sharedMesh = Mesh;
            return true;
        }

        /// <summary>Be solid no longer.</summary>
        internal void Clear() { collider.sharedMesh = null; }

        internal void Destroy()
        {
            // A mesh must not go while a thread reads it: some milliseconds.
            if (cooking != null) Task.WaitAny(cooking);
            cooking = null;
            Engine.Destroy(collider);
            Engine.Destroy(Mesh);
        }
    }
}
