using System;
using System.Collections.Generic;
using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>A texture made from a payload's image.</summary>
    public struct PhotoTexture
    {
        /// <summary>The texture; the one that asked for it destroys it.</summary>
        public Texture2D Texture;

        /// <summary>Its first row is the image's uppermost, unlike Unity's own: V is turned when it is drawn.</summary>
        public bool IsTopDown;
    }

    /// <summary>One image on its way from a file to a texture.</summary>
    internal sealed class PhotoLoad
    {
        internal byte[] File;
        internal ImageHeader Header;

        /// <summary>What another package makes of it; null where Unity reads it.</summary>
        internal Task<PhotoTexture> Task;
        internal PhotoTexture Result;
        internal TerraportException Error;

        /// <summary>Nobody waits for it: what still comes is destroyed.</summary>
        internal bool IsAbandoned;

        internal bool IsDone => Error != null || Result.Texture != null;
    }

    /// <summary>
    /// Makes textures from images, at most one JPEG or PNG in a frame: Unity reads those on the main thread, which takes milliseconds. KTX2 is
    /// read on threads by another package. Main thread.
    /// </summary>
    public sealed class PhotoLoader : IDisposable
    {
        private readonly Queue<PhotoLoad> waiting = new Queue<PhotoLoad>();
        private readonly List<PhotoLoad> running = new List<PhotoLoad>();
        private bool isDisposed;

        /// <summary>
        /// Reads KTX2: file in, texture out; null without a package that can. Terraport.Ktx sets it where com.unity.cloud.ktx is installed; a
        /// project may set its own.
        /// </summary>
        public static Func<byte[], Task<PhotoTexture>> KtxReader { get; set; }

        /// <summary>Begin to read an image.</summary>
        /// <exception cref="TerraportException">Nothing here reads images of that type.</exception>
        internal PhotoLoad Begin(byte[] file, ImageHeader header)
        {
            bool isKtx = header.MediaType == "image/ktx2";
            if (header.MediaType == "image/webp" || (isKtx && KtxReader == null))
            {
                string hint = isKtx ? "install com.unity.cloud.ktx" : "expected JPEG or PNG";
                throw new TerraportException("unsupported_image", "image is " + header.MediaType + ", " + hint);
            }
            var load = new PhotoLoad { File = file, Header = header };
            waiting.Enqueue(load);
            return load;
        }

        /// <summary>Destroy the texture of an image, now or when it comes.</summary>
        internal void Abandon(PhotoLoad load)
        {
            load.IsAbandoned = true;
            load.File = null;
            Engine.Destroy(load.Result.Texture);
            load.Result = default;
        }

        /// <summary>Once per frame: take what threads have finished, and read the next image.</summary>
        internal void Step()
        {
            for (int at = running.Count - 1; at >= 0; at--)
            {
                if (!running[at].Task.IsCompleted) continue;
                Finish(running[at]);
                running.RemoveAt(at);
            }
            while (waiting.Count > 0)
            {
                PhotoLoad load = waiting.Dequeue();
                if (load.IsAbandoned) continue;
                Read(load);
                return;
            }
        }

        /// <summary>Abandon every image that is on its way.</summary>
        public void Dispose()
        {
            isDisposed = true;
            waiting.Clear();
            foreach (PhotoLoad load in running)
            {
                // Comes back to the main thread: textures can be destroyed there alone.
                load.Task.ContinueWith(
                    _ => Finish(load), TaskScheduler.FromCurrentSynchronizationContext());
            }
            running.Clear();
        }

        private void Read(PhotoLoad load)
        {
            byte[] file = load.File;
            load.File = null;
            if (load.Header.MediaType == "image/ktx2")
            {
                load.Task = BeginKtx(file);
                running.Add(load);
                return;
            }
            // The size is set from the file; mips are made since the empty texture asks for them; colours are sRGB. No readable copy stays.
            var texture = new Texture2D(2, 2, TextureFormat.RGBA32, true, false);
            if (texture.LoadImage(file, true) && texture.width == load.Header.Width && texture.height == load.Header.Height)
            {
                Accept(load, new PhotoTexture { Texture = texture });
                return;
            }
            Engine.Destroy(texture);
            load.Error =
                new TerraportException("bad_image", "image of " + file.Length + " bytes (" + load.Header.MediaType + ") cannot be read");
        }

        /// <summary>What a project's own reader throws at once is a failure like any other.</summary>
        private static Task<PhotoTexture> BeginKtx(byte[] file)
        {
            try
            {
                return KtxReader(file);
            }
            catch (Exception error)
            {
                return Task.FromException<PhotoTexture>(error);
            }
        }

        private void Finish(PhotoLoad load)
        {
            if (load.Task.Status == TaskStatus.RanToCompletion && load.Task.Result.Texture != null)
            {
                Accept(load, load.Task.Result);
                return;
            }
            string reason = load.Task.Exception == null ? "" : ": " + load.Task.Exception.GetBaseException().Message;
            load.Error = new TerraportException("bad_image", "image (" + load.Header.MediaType + ") cannot be read" + reason);
        }

        private void Accept(PhotoLoad load, PhotoTexture result)
        {
            if (load.IsAbandoned || isDisposed)
            {
                Engine.Destroy(result.Texture);
                return;
            }
            result.Texture.hideFlags = HideFlags.DontSave;
            // An atlas does not repeat: its edges would bleed into each other. Ground is seen at grazing angles: anisotropic.
            result.Texture.wrapMode = TextureWrapMode.Clamp;
            result.Texture.filterMode = FilterMode.Trilinear;
            result.Texture.anisoLevel = 4;
            load.Result = result;
        }
    }
}
