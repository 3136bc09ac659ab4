using System;
using System.Collections.Generic;
using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// Makes textures from payloads' images, at most one JPEG or PNG in a frame: Unity reads those on the main thread alone, which
    /// takes milliseconds for each. KTX2 is read on threads, by another package. Main thread.
    /// </summary>
    public sealed class PhotoLoader : IDisposable
    {
        // waiting: files in the order asked for. running: KTX2 images that tasks are reading.
        private readonly Queue<PhotoLoad> waiting = new Queue<PhotoLoad>();
        private readonly List<PhotoLoad> running = new List<PhotoLoad>();
        private bool isDisposed;

        /// <summary>
        /// Reads KTX2: file in, texture out; null without a package that can. Terraport.Ktx sets it where com.unity.cloud.ktx is
        /// installed; a project may set its own reader.
        /// </summary>
        public static Func<byte[], Task<PhotoTexture>> KtxReader { get; set; }

        /// <summary>Whether images of a media type can be read here.</summary>
        public static bool CanRead(string mediaType)
        {
            return mediaType == "image/jpeg" || mediaType == "image/png" || (mediaType == "image/ktx2" && KtxReader != null);
        }

        /// <summary>Images that wait or are being read.</summary>
        public int Pending => waiting.Count + running.Count;

        /// <summary>Begin to read a mesh's image; the file is copied, so the mesh may be reused.</summary>
        /// <exception cref="TerraportException">Nothing here reads images of that media type.</exception>
        internal PhotoLoad Begin(MeshImage image)
        {
            if (!CanRead(image.MediaType))
            {
                string hint = image.MediaType == "image/ktx2" ? ", install com.unity.cloud.ktx" : ", expected image/jpeg or image/png";
                throw new TerraportException("unsupported_image", "image is " + image.MediaType + hint);
            }
            // Exactly as long as the file: Unity's reader takes whole arrays. The one piece of garbage that an upload makes.
            byte[] file = new byte[image.Length];
            Buffer.BlockCopy(image.Bytes, 0, file, 0, image.Length);
            PhotoLoad load = new PhotoLoad();
            load.File = file;
            load.MediaType = image.MediaType;
            load.Width = image.Width;
            load.Height = image.Height;
            waiting.Enqueue(load);
            return load;
        }

        /// <summary>Nobody wants it any more: its texture is destroyed, now or when it comes.</summary>
        internal void Abandon(PhotoLoad load)
        {
            load.IsAbandoned = true;
            // A load that still waits is skipped by Step; one whose task runs is destroyed when it comes.
            load.File = null;
            Engine.Destroy(load.Result.Texture);
            load.Result = default(PhotoTexture);
        }

        /// <summary>Once per frame: take what threads finished, and read the next image.</summary>
        public void Step()
        {
            // Backwards: finished loads are removed on the way.
            for (int at = running.Count - 1; at >= 0; at--)
            {
                if (running[at].Task.IsCompleted)
                {
                    Finish(running[at]);
                    running.RemoveAt(at);
                }
            }
            while (waiting.Count > 0)
            {
                PhotoLoad load = waiting.Dequeue();
                if (load.IsAbandoned)
                {
                    continue;
                }
                // One a frame: LoadImage decodes on the main thread.
                Read(load);
                return;
            }
        }

        /// <summary>Abandon every image that is on its way; what tasks still finish is destroyed when it comes.</summary>
        public void Dispose()
        {
            isDisposed = true;
            foreach (PhotoLoad load in waiting)
            {
                Abandon(load);
            }
            waiting.Clear();
            foreach (PhotoLoad load in running)
            {
                PhotoLoad abandoned = load;
                Abandon(abandoned);
                // Comes back to the main thread where Unity's scheduler is the current one: textures can be destroyed there alone.
                abandoned.Task.ContinueWith(
                    _ => Finish(abandoned), TaskScheduler.FromCurrentSynchronizationContext());
            }
            running.Clear();
        }

        private void Read(PhotoLoad load)
        {
            // Taken off the load, so that the file is collected as soon as it is read.
            byte[] file = load.File;
            load.File = null;
            if (load.MediaType == "image/ktx2")
            {
                load.Task = BeginKtx(file);
                running.Add(load);
                return;
            }
            // The size is Unity's to set from the file; mips are made since the empty texture asks for them; colours are sRGB.
            Texture2D texture = new Texture2D(2, 2, TextureFormat.RGBA32, true, false);
            // true: no readable copy stays in main memory. Sides must be what the checked header said.
            if (!texture.LoadImage(file, true) || texture.width != load.Width || texture.height != load.Height)
            {
                Engine.Destroy(texture);
                load.Error =
                    new TerraportException("bad_image", "image of " + file.Length + " bytes (" + load.MediaType + ") cannot be read");
                return;
            }
            PhotoTexture result = default(PhotoTexture);
            result.Texture = texture;
            Accept(load, result);
        }

        /// <summary>What a project's own reader throws at once is a failure like any other; unseen, the landing would wait for ever.</summary>
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
            if (load.Task.IsFaulted || load.Task.IsCanceled || load.Task.Result.Texture == null)
            {
                string reason = load.Task.Exception == null ? "" : ": " + load.Task.Exception.GetBaseException().Message;
                load.Error = new TerraportException("bad_image", "image (" + load.MediaType + ") cannot be read" + reason);
                return;
            }
            Accept(load, load.Task.Result);
        }

        private void Accept(PhotoLoad load, PhotoTexture result)
        {
            // It came too late: nobody would destroy it.
            if (load.IsAbandoned || isDisposed)
            {
                Engine.Destroy(result.Texture);
                return;
            }
            result.Texture.hideFlags = HideFlags.DontSave;
            // An atlas does not repeat: its edges would bleed into each other.
            result.Texture.wrapMode = TextureWrapMode.Clamp;
            result.Texture.filterMode = FilterMode.Trilinear;
            // Ground is seen at grazing angles: without it, photographs blur away a few metres from the feet.
            result.Texture.anisoLevel = 4;
            load.Result = result;
        }
    }
}
