using System.Threading.Tasks;
using KtxUnity;
using Unity.Collections;
using UnityEngine;
using UnityEngine.Scripting;
#if UNITY_EDITOR
using UnityEditor;
#endif

// Nothing refers to this assembly: without it, a player build would leave the assembly out, and KTX2 could not be read there.
[assembly:AlwaysLinkAssembly]

namespace Terraport.Unity
{
    /// <summary>
    /// Reads KTX2 images by com.unity.cloud.ktx. Compiled where that package is installed; it then registers itself.
    /// </summary>
    public static class KtxPhotos
    {
        /// <summary>
        /// Let <see cref="PhotoLoader"/> read KTX2. Done before the first scene is loaded, also with domain reload off; in the editor also
        /// when scripts are loaded, for the preview.
        /// </summary>
#if UNITY_EDITOR
        [InitializeOnLoadMethod]
#endif
        [RuntimeInitializeOnLoadMethod(RuntimeInitializeLoadType.BeforeSceneLoad)]
        public static void Register() { PhotoLoader.KtxReader = ReadAsync; }

        private static async Task<PhotoTexture> ReadAsync(byte[] file)
        {
            PhotoTexture photo = default(PhotoTexture);
            // The managed array is pinned and read in place, and must be so until the texture is there.
            using (ManagedNativeArray pinned = new ManagedNativeArray(file))
            {
#if TERRAPORT_KTX_READ_ONLY
                TextureResult result = await new KtxTexture().LoadFromBytes(pinned.nativeArray.AsReadOnly(), false);
#else
                TextureResult result = await new KtxTexture().LoadFromBytes(pinned.nativeArray, false);
#endif
                if (result == null || result.errorCode != ErrorCode.Success)
                {
                    throw new TerraportException("bad_image", "KTX2: " + (result == null ? "no result" : result.errorCode.ToString()));
                }
                photo.Texture = result.texture;
                photo.IsTopDown = result.orientation.IsYFlipped();
            }
            return photo;
        }
    }
}
