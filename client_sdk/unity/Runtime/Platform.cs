using System;
using System.IO;
using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>What differs between platforms: a browser has no threads and no sockets but its own.</summary>
    internal static class Platform
    {
#if UNITY_WEBGL && !UNITY_EDITOR
        /// <summary>Whether work can be done beside the main thread.</summary>
        public static bool HasThreads => false;

        /// <summary>Runs work beside the main thread; null where there is no beside.</summary>
        public static Func<Action, Task> Aside => null;

        /// <summary>Where payloads are kept from one run to the next; null for nowhere: a page has no disk but the browser's own cache.</summary>
        public static string DiskFolder => null;

        /// <summary>How files are fetched unless a project says otherwise.</summary>
        public static IHttp MakeHttp() { return new WebRequestHttp(); }

        public static ISceneStream OpenStream(StreamOptions options, ITransportFactory transports)
        {
            return new SceneStream(options, transports ?? new WebGlTransportFactory());
        }

        public static IDecodeQueue MakeDecoders(TerraportSettings settings, Action<SegmentMesh> afterDecode)
        {
            return new InlineDecodes(afterDecode);
        }
#else
        /// <summary>Whether work can be done beside the main thread.</summary>
        public static bool HasThreads => true;

        /// <summary>Runs work beside the main thread; null where there is no beside.</summary>
        public static Func<Action, Task> Aside => Task.Run;

        /// <summary>Where payloads are kept from one run to the next; the system may empty it.</summary>
        public static string DiskFolder => Path.Combine(Application.temporaryCachePath, "terraport");

        /// <summary>How files are fetched unless a project says otherwise.</summary>
        public static IHttp MakeHttp() { return new SystemHttp(); }

        /// <summary>A stream that is pumped on a thread of its own.</summary>
        public static ISceneStream OpenStream(StreamOptions options, ITransportFactory transports)
        {
            return new ThreadedStream(options, transports ?? new WebSocketTransportFactory());
        }

        /// <summary>Threads that decode and pack.</summary>
        public static IDecodeQueue MakeDecoders(TerraportSettings settings, Action<SegmentMesh> afterDecode)
        {
            return new DecodeThreads(settings.ActualDecodeThreads, afterDecode);
        }
#endif
    }
}
