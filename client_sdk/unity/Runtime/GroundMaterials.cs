using System;
using System.Collections.Generic;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>The materials that ground is drawn with: one for all coloured detail, one for the base, and one per photograph.</summary>
    internal sealed class GroundMaterials : IDisposable
    {
        private const string UnlitShader = "TerraportGround";
        private const string LitShader = "TerraportGroundLit";

        // Ids instead of names: a lookup by name hashes a string at every call.
        private static readonly int PushId = Shader.PropertyToID("_TerraportPushM");
        private static readonly int ReliefId = Shader.PropertyToID("_TerraportRelief");
        private static readonly int HasPhotoId = Shader.PropertyToID("_TerraportHasPhoto");

        private readonly Material detail;
        private readonly Material ground;
        // What the shader is told of an image: 1 a photograph, 2 the points' colours.
        private float photoKind = 1;
        // Materials without a photograph, to be used again: making one costs garbage.
        private readonly Stack<Material> spareDetailPhotos = new Stack<Material>();

        /// <param name="detailOverride">The project's own material for detail, copied; null for this package's shader.</param>
        /// <param name="baseOverride">The project's own material for the base, copied; null likewise.</param>
        /// <param name="settings">Whether the package's own take the project's lights, and else how much of the shape's.</param>
        public GroundMaterials(Material detailOverride, Material baseOverride, TerraportSettings settings)
        {
            detail = Make(detailOverride, settings);
            ground = Make(baseOverride, settings);
            // After the detail, which stands before it nearly everywhere: what the detail hides is not shaded.
            ground.renderQueue = detail.renderQueue + 1;
        }

        /// <summary>The one material of all segments with vertex colours.</summary>
        public Material Detail => detail;

        /// <summary>The material of a base with vertex colours, or of one whose photograph is missing.</summary>
        public Material Base => ground;

        /// <summary>How far the base is pushed back along the line of sight, metres: the scene's deviation.</summary>
        public void SetPush(double deviationM) { SetFloat(ground, PushId, (float)deviationM); }

        /// <summary>Whether images are the points' colours: they are lit as vertex colours are. For materials from now on.</summary>
        public void SetPointImages(bool ofPoints) { photoKind = ofPoints ? 2 : 1; }

        /// <summary>A material with a photograph for a segment; give it back by <see cref="ReturnDetail"/>.</summary>
        public Material TakeDetail(PhotoTexture photo)
        {
            return WithPhoto(spareDetailPhotos.Count > 0 ? spareDetailPhotos.Pop() : Copy(detail), photo);
        }

        /// <summary>Take a segment's material back.</summary>
        public void ReturnDetail(Material material)
        {
            // Else the spare material would keep the texture alive.
            material.mainTexture = null;
            spareDetailPhotos.Push(material);
        }

        /// <summary>A material with the base's photograph, pushed back as the base is; destroy it after use.</summary>
        public Material MakeBase(PhotoTexture photo) { return WithPhoto(Copy(ground), photo); }

        /// <summary>Destroy all materials that are not handed out.</summary>
        public void Dispose()
        {
            while (spareDetailPhotos.Count > 0)
            {
                Engine.Destroy(spareDetailPhotos.Pop());
            }
            Engine.Destroy(detail);
            Engine.Destroy(ground);
        }

        private static Material Make(Material own, TerraportSettings settings)
        {
            if (own != null)
            {
                return Copy(own);
            }
            string name = settings.lit ? LitShader : UnlitShader;
            Shader shader = Resources.Load<Shader>(name);
            if (shader == null || !shader.isSupported)
            {
                throw new TerraportException("shader", "shader " + name + " is missing or not supported here; set materials of your own");
            }
            Material material = new Material(shader);
            // Not saved: what this package makes must never end up in a project's scene file.
            material.hideFlags = HideFlags.DontSave;
            SetFloat(material, ReliefId, settings.relief);
            return material;
        }

        private static Material Copy(Material from)
        {
            Material material = new Material(from);
            material.hideFlags = HideFlags.DontSave;
            return material;
        }

        private Material WithPhoto(Material material, PhotoTexture photo)
        {
            material.mainTexture = photo.Texture;
            // v' = 1 - v for images whose first row is the uppermost: payloads' V was turned for Unity's lower-left origin.
            material.mainTextureScale = new Vector2(1, photo.IsTopDown ? -1 : 1);
            material.mainTextureOffset = new Vector2(0, photo.IsTopDown ? 1 : 0);
            SetFloat(material, HasPhotoId, photoKind);
            return material;
        }

        private static void SetFloat(Material material, int id, float value)
        {
            // A project's own material need not have our properties.
            if (material.HasProperty(id))
            {
                material.SetFloat(id, value);
            }
        }
    }
}
