using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>One photograph on its way from a file to a texture. Main thread.</summary>
    internal sealed class PhotoLoad
    {
        /// <summary>The file as it is; null once it is read.</summary>
        public byte[] File;

        /// <summary>"image/jpeg", "image/png" or "image/ktx2".</summary>
        public string MediaType;

        /// <summary>Pixels that its header promised.</summary>
        public int Width, Height;

        /// <summary>What another package is making of it; null where Unity reads it at once.</summary>
        public Task<PhotoTexture> Task;

        /// <summary>The result; its Texture is null until then.</summary>
        public PhotoTexture Result;

        /// <summary>Why there will be none; else null.</summary>
        public TerraportException Error;

        /// <summary>Nobody waits for it any more: what still comes is destroyed.</summary>
        public bool IsAbandoned;

        /// <summary>Whether there is a result or an error.</summary>
        public bool IsDone => Error != null || Result.Texture != null;
    }
}
