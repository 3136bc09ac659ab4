using System;
using Terraport.Json;

namespace Terraport
{
    /// <summary>
    /// The texture of a GLB, found along the chain from the material: glTF 2.0 (sections 3.8 and 3.9), EXT_texture_webp,
    /// KHR_texture_basisu, KHR_texture_transform.
    /// </summary>
    internal struct GlbTexture
    {
        internal const string UvTransform = "KHR_texture_transform";
        internal const string WebpExtension = "EXT_texture_webp";
        internal const string BasisExtension = "KHR_texture_basisu";

        /// <summary>Least scale: of an image with sides of up to 32768 texels, half a texel a step.</summary>
        private const double MinScale = 1.0 / 65536;

        /// <summary>Node that holds the number of the image's bufferView.</summary>
        internal int View;

        /// <summary>By the document; the image's own bytes must agree.</summary>
        internal string MediaType;

        /// <summary>Texture coordinates have a transform; else they are fractions of 65535.</summary>
        internal bool HasScale;

        internal double ScaleU;

        internal double ScaleV;

        /// <summary>Find the texture of a primitive's material; false where it has none.</summary>
        /// <exception cref="PayloadException">The chain is broken, or outside the profile.</exception>
        internal static bool TryFind(GlbDocument document, int primitive, out GlbTexture texture)
        {
            texture = new GlbTexture();
            JsonTape tape = document.Tape;
            int materialNode = tape.Find(primitive, "material");
            if (materialNode < 0)
            {
                return false;
            }
            int material = document.Pick("materials", materialNode, "material", null);
            int textureInfo = document.Find(document.OptionalObject(material, "pbrMetallicRoughness"), "baseColorTexture");
            if (textureInfo < 0)
            {
                return false;
            }
            document.ExpectObject(textureInfo, "baseColorTexture", null);
            int texCoord = tape.Find(textureInfo, "texCoord");
            if (texCoord >= 0 && (!tape.IsNumber(texCoord) || tape.NumberOf(texCoord) != 0))
            {
                throw new PayloadException("baseColorTexture has another set, expected set 0");
            }
            texture.FindImage(document, textureInfo);
            texture.FindScale(document, textureInfo);
            return true;
        }

        private static bool IsScale(GlbDocument document, int node, out double scale)
        {
            scale = document.Tape.IsNumber(node) ? document.Tape.NumberOf(node) : 0;
            // A power of two has no bits of mantissa.
            return scale >= MinScale && scale <= 1 && (BitConverter.DoubleToInt64Bits(scale) & 0xFFFFFFFFFFFFF) == 0;
        }

        private void FindImage(GlbDocument document, int textureInfo)
        {
            JsonTape tape = document.Tape;
            int texture = document.Pick("textures", tape.Find(textureInfo, "index"), "texture", null);
            int extensions = document.OptionalObject(texture, "extensions");
            int source = tape.Find(texture, "source");
            // Without an extension glTF allows these two; each extension replaces the source and allows one type alone.
            string mediaType = "image/jpeg";
            string alternative = "image/png";
            int webp = document.OptionalObject(extensions, WebpExtension);
            if (webp >= 0)
            {
                source = tape.Find(webp, "source");
                mediaType = alternative = "image/webp";
            }
            int basis = document.OptionalObject(extensions, BasisExtension);
            if (basis >= 0)
            {
                source = tape.Find(basis, "source");
                mediaType = alternative = "image/ktx2";
            }
            int image = document.Pick("images", source, "image", null);
            int mimeType = tape.Find(image, "mimeType");
            MediaType = tape.IsEqual(mimeType, mediaType) ? mediaType : tape.IsEqual(mimeType, alternative) ? alternative : null;
            if (MediaType == null)
            {
                throw document.Wrong(
                    mimeType, "mimeType", "image", mediaType == alternative ? mediaType : mediaType + " or " + alternative);
            }
            View = tape.Find(image, "bufferView");
        }

        private void FindScale(GlbDocument document, int textureInfo)
        {
            JsonTape tape = document.Tape;
            int extensions = document.OptionalObject(textureInfo, "extensions");
            // No transform: codes are fractions of 65535.
            if (extensions < 0 || tape.CountOf(extensions) == 0)
            {
                return;
            }
            int transform = document.ExpectObject(tape.Find(extensions, UvTransform), UvTransform, null);
            int scale = document.ExpectList(tape.Find(transform, "scale"), "scale");
            // One member, "scale": an offset or a rotation would need a shader that clients do not have.
            bool isPair = tape.CountOf(transform) == 1 && tape.CountOf(scale) == 2;
            int second = isPair ? tape.After(tape.FirstOf(scale)) : JsonTape.None;
            if (!isPair || !IsScale(document, tape.FirstOf(scale), out ScaleU) || !IsScale(document, second, out ScaleV))
            {
                throw new PayloadException(UvTransform + " is no scale of two powers of two up to 1 alone");
            }
            HasScale = true;
        }
    }
}
