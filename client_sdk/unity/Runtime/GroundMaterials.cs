using System;
using System.Collections.Generic;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>The materials of the ground: one for all coloured detail, one for the base, and one for each image.</summary>
    internal sealed class GroundMaterials : IDisposable
    {
        // Ids instead of names: a lookup by name hashes a string at every call.
        private static readonly int PushId = Shader.PropertyToID("_TerraportPushM");
        private static readonly int ReliefId = Shader.PropertyToID("_TerraportRelief");
        private static readonly int HasPhotoId = Shader.PropertyToID("_TerraportHasPhoto");

        private readonly Stack<Material> spareDetails = new Stack<Material>();

        /// <param name="detail">The project's own material for detail, copied; null for the package's shader.</param>
        /// <param name="ground">The project's own material for the base, copied; null likewise.</param>
        /// <param name="settings">How the package's own are lit.</param>
        internal GroundMaterials(Material detail, Material ground, TerraportSettings settings)
        {
            Detail = Make(detail, settings);
            Base = Make(ground, settings);
            // After the detail, which is in front of it nearly everywhere: what the detail hides is not shaded.
            Base.renderQueue = Detail.renderQueue + 1;
        }

        /// <summary>The material of all segments with vertex colours.</summary>
        internal Material Detail { get; }

        /// <summary>The material of a base without an image.</summary>
        internal Material Base { get; }

        /// <summary>Images show the points' colours and no photographs: they are lit as vertex colours are. For materials from now on.</summary>
        internal bool HasImagesOfPoints { get; set; }

        /// <summary>Set how far the base is pushed back along the line of sight, metres.</summary>
        internal void SetPush(double deviationM) { SetFloat(Base, PushId, (float)deviationM); }

        /// <summary>Take a material with a segment's image.</summary>
        internal Material TakeDetail(PhotoTexture photo)
        {
            return WithPhoto(spareDetails.Count > 0 ? spareDetails.Pop() : Copy(Detail), photo);
        }

        /// <summary>Give a segment's material back.</summary>
        internal void ReturnDetail(Material material)
        {
            // Else the spare material would keep the texture alive.
            material.mainTexture = null;
            spareDetails.Push(material);
        }

        /// <summary>Make a material with the base's image; destroy it after use.</summary>
        internal Material MakeBase(PhotoTexture photo) { return WithPhoto(Copy(Base), photo); }

        public void Dispose()
        {
            while (spareDetails.Count > 0) Engine.Destroy(spareDetails.Pop());
            Engine.Destroy(Detail);
            Engine.Destroy(Base);
        }

        private static Material Make(Material own, TerraportSettings settings)
        {
            if (own != null) return Copy(own);
            string name = settings.lit ? "TerraportGroundLit" : "TerraportGround";
            Shader shader = Resources.Load<Shader>(name);
            if (shader == null || !shader.isSupported)
                throw new TerraportException("shader", "shader " + name + " is missing or not supported here; set materials of your own");
            var material = new Material(shader) { hideFlags = HideFlags.DontSave };
            SetFloat(material, ReliefId, settings.relief);
            return material;
        }

        // Not saved: what this package makes must never end up in a project's scene file.
        private static Material Copy(Material from) { return new Material(from) { hideFlags = HideFlags.DontSave }; }

        private Material WithPhoto(Material material, PhotoTexture photo)
        {
            material.mainTexture = photo.Texture;
            // V was turned for images whose first row is the lowest, as Unity has them.
            material.mainTextureScale = new Vector2(1, photo.IsTopDown ? -1 : 1);
            material.mainTextureOffset = new Vector2(0, photo.IsTopDown ? 1 : 0);
            SetFloat(material, HasPhotoId, HasImagesOfPoints ? 2 : 1);
            return material;
        }

        private static void SetFloat(Material material, int id, float value)
        {
            // A project's own material need not have our properties.
            if (material.HasProperty(id)) material.SetFloat(id, value);
        }
    }
}
