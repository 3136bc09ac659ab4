using UnityEngine;
using UnityEngine.Rendering;

namespace Terraport.Unity
{
    /// <summary>
    /// One drawable piece of ground: an object with a mesh of its own, hidden until it is shown. Pooled, since making objects and
    /// meshes is what costs garbage and time.
    /// </summary>
    internal sealed class GroundNode
    {
        private readonly GameObject holder;
        private readonly MeshRenderer renderer;

        /// <summary>A hidden piece below <paramref name="parent"/>, at the scene's origin, not saved with the scene.</summary>
        /// <param name="isLit">It casts and receives shadows.</param>
        public GroundNode(Transform parent, bool isLit)
        {
            holder = new GameObject("terraport ground");
            // In the editor's preview not to be seen among the objects, either.
            holder.hideFlags = Application.isPlaying ? HideFlags.DontSave : HideFlags.HideAndDontSave;
            holder.layer = parent.gameObject.layer;
            holder.transform.SetParent(parent, false);
            Mesh = new Mesh();
            Mesh.name = "terraport ground";
            Mesh.hideFlags = HideFlags.DontSave;
            // Filled again and again: tells Unity to expect it.
            Mesh.MarkDynamic();
            holder.AddComponent<MeshFilter>().sharedMesh = Mesh;
            renderer = holder.AddComponent<MeshRenderer>();
            // What the shader does not use is switched off: each would cost work per object and frame. The survey's colours hold its light.
            // Two-sided, since a survey is an open sheet: seen from the light its rim may show its underside.
            renderer.shadowCastingMode = isLit ? ShadowCastingMode.TwoSided : ShadowCastingMode.Off;
            renderer.receiveShadows = isLit;
            renderer.lightProbeUsage = LightProbeUsage.Off;
            renderer.reflectionProbeUsage = ReflectionProbeUsage.Off;
            renderer.motionVectorGenerationMode = MotionVectorGenerationMode.Camera;
            renderer.allowOcclusionWhenDynamic = false;
            // By the renderer and not by the object: activating an object runs through all of its components.
            renderer.enabled = false;
        }

        /// <summary>Its mesh; readable, so that it can be filled again.</summary>
        public Mesh Mesh { get; private set; }

        /// <summary>Its photograph on its way or there; null without one.</summary>
        public PhotoLoad Photo { get; set; }

        /// <summary>A material of its own, with its photograph; null where it shares one.</summary>
        public Material PhotoMaterial { get; set; }

        /// <summary>Triangles that are drawn when it is shown.</summary>
        public int FaceCount { get; set; }

        /// <summary>Whether its object is there: a project may have destroyed what lies below the scene's object.</summary>
        public bool IsAlive => renderer != null;

        /// <summary>Whether it is drawn; setting it is all that a swap does.</summary>
        public bool IsShown
        {
            get {
                // Unity's != null is false for an object that was destroyed.
                return renderer != null && renderer.enabled;
            }

            set {
                if (renderer != null)
                {
                    renderer.enabled = value;
                }
            }
        }

        /// <summary>Material that it is drawn with; stays the caller's.</summary>
        public Material Material
        {
            set {
                if (renderer != null)
                {
                    renderer.sharedMaterial = value;
                }
            }
        }

        /// <summary>Destroy object and mesh.</summary>
        public void Destroy()
        {
            Engine.Destroy(holder);
            // Meshes are not collected with their objects.
            Engine.Destroy(Mesh);
        }
    }
}
