using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>Darkness before every camera: one face over the whole picture.</summary>
    internal sealed class FadeCurtain
    {
        private const string ShaderName = "TerraportFade";

        private static readonly int FadeId = Shader.PropertyToID("_TerraportFade");

        private readonly GameObject holder;
        private readonly MeshRenderer curtain;
        private readonly Material material;
        private readonly Mesh mesh;

        internal FadeCurtain()
        {
            mesh = new Mesh();
            mesh.name = "terraport fade";
            mesh.hideFlags = HideFlags.DontSave;
            mesh.SetVertices(new[] { new Vector3(-1, -1, 0), new Vector3(3, -1, 0), new Vector3(-1, 3, 0) });
            mesh.SetIndices(new[] { 0, 1, 2 }, MeshTopology.Triangles, 0);
            // Never out of sight: its corners are the picture's, not the world's.
            mesh.bounds = new Bounds(new Vector3(0, 0, 0), new Vector3(1e6f, 1e6f, 1e6f));
            material = new Material(Resources.Load<Shader>(ShaderName));
            material.hideFlags = HideFlags.DontSave;
            holder = new GameObject("terraport fade");
            holder.hideFlags = HideFlags.DontSave;
            holder.AddComponent<MeshFilter>().sharedMesh = mesh;
            curtain = holder.AddComponent<MeshRenderer>();
            curtain.sharedMaterial = material;
            curtain.enabled = false;
        }

        /// <summary>0 for clear, 1 for black.</summary>
        internal float Darkness
        {
            set {
                curtain.enabled = value > 0;
                material.SetFloat(FadeId, value);
            }
        }

        internal void Destroy()
        {
            Engine.Destroy(holder);
            Engine.Destroy(material);
            Engine.Destroy(mesh);
        }
    }
}
