using System;
using System.Collections.Generic;
using UnityEngine;
using UnityEngine.Rendering;

namespace Terraport.Unity
{
    /// <summary>One drawable piece of ground: an object with a mesh, hidden until it is shown.</summary>
    internal sealed class GroundNode
    {
        private readonly GameObject holder;
        private readonly MeshRenderer renderer;

        internal GroundNode(Transform parent, bool isLit)
        {
            holder = new GameObject("terraport ground");
            // In the editor's preview not listed among the objects either.
            holder.hideFlags = Application.isPlaying ? HideFlags.DontSave : HideFlags.HideAndDontSave;
            holder.layer = parent.gameObject.layer;
            holder.transform.SetParent(parent, false);
            Mesh = new Mesh { name = "terraport ground", hideFlags = HideFlags.DontSave };
            Mesh.MarkDynamic();
            holder.AddComponent<MeshFilter>().sharedMesh = Mesh;
            renderer = holder.AddComponent<MeshRenderer>();
            // What the shader does not use would cost work per object and frame. Two-sided shadows: a survey is an open sheet.
            renderer.shadowCastingMode = isLit ? ShadowCastingMode.TwoSided : ShadowCastingMode.Off;
            renderer.receiveShadows = isLit;
            renderer.lightProbeUsage = LightProbeUsage.Off;
            renderer.reflectionProbeUsage = ReflectionProbeUsage.Off;
            renderer.motionVectorGenerationMode = MotionVectorGenerationMode.Camera;
            renderer.allowOcclusionWhenDynamic = false;
            // By the renderer and not by the object: activating an object runs through all of its components.
            renderer.enabled = false;
        }

        internal Mesh Mesh { get; }

        /// <summary>Triangles that are drawn when it is shown.</summary>
        internal int FaceCount { get; set; }

        /// <summary>Its image, on its way or there, and the material with it; null without one.</summary>
        internal PhotoLoad Photo { get; set; }

        internal Material PhotoMaterial { get; set; }

        /// <summary>Whether its object is there: a project may have destroyed what is below the scene's object.</summary>
        internal bool IsAlive => renderer != null;

        /// <summary>Whether it is drawn; setting it is all that a swap does.</summary>
        internal bool IsShown
        {
            get => renderer != null && renderer.enabled;
            set {
                if (renderer != null) renderer.enabled = value;
            }
        }

        internal int DrawnFaces => IsShown ? FaceCount : 0;

        /// <summary>Material that it is drawn with; stays the caller's.</summary>
        internal void SetMaterial(Material material)
        {
            if (renderer != null) renderer.sharedMaterial = material;
        }

        internal void Destroy()
        {
            Engine.Destroy(holder);
            // Meshes are not collected with their objects.
            Engine.Destroy(Mesh);
        }
    }

    /// <summary>Pieces of ground that are used again: making objects and meshes is what costs garbage and time.</summary>
    internal sealed class GroundPool : IDisposable
    {
        /// <summary>A quarter of the segments of a headset's landing: enough for hops, and a bound of the memory.</summary>
        private const int MaxSpares = 128;

        private readonly Transform parent;
        private readonly bool isLit;
        private readonly Stack<GroundNode> spares = new Stack<GroundNode>();

        internal GroundPool(Transform parent, bool isLit)
        {
            this.parent = parent;
            this.isLit = isLit;
        }

        /// <summary>Pieces made and not destroyed.</summary>
        internal int Count { get; private set; }

        /// <summary>Take a hidden piece.</summary>
        internal GroundNode Take()
        {
            while (spares.Count > 0)
            {
                GroundNode spare = spares.Pop();
                if (spare.IsAlive) return spare;
                Count--;
                spare.Destroy();
            }
            Count++;
            return new GroundNode(parent, isLit);
        }

        /// <summary>Give a piece back; it is hidden and loses its image, which is the caller's.</summary>
        internal void Return(GroundNode node)
        {
            node.IsShown = false;
            node.Photo = null;
            node.PhotoMaterial = null;
            if (node.IsAlive && spares.Count < MaxSpares)
            {
                spares.Push(node);
                return;
            }
            Count--;
            node.Destroy();
        }

        public void Dispose()
        {
            Count -= spares.Count;
            while (spares.Count > 0) spares.Pop().Destroy();
        }
    }
}
