using System;
using System.Threading;
using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>One opening of a scene, from Open to Close: its files, its visit and what draws it. Main thread.</summary>
    internal sealed class SceneSession : IDisposable
    {
        // Between two attempts to load the files; doubled each time.
        private const float MinRetryS = 2, MaxRetryS = 30;

        private readonly TerraportSettings settings;
        private readonly DeviceBudgets budgets;
        private readonly string url;
        private readonly PhotoLoader photos = new PhotoLoader();
        private readonly GroundMaterials materials;
        private readonly CancellationTokenSource cancel = new CancellationTokenSource();
        private readonly Func<string> token;
        // Null while nothing is loaded.
        private Task<SceneFiles> loading;
        // Seconds of realtimeSinceStartup, which continues while the game's time is scaled or stopped.
        private float retryAtS = float.PositiveInfinity, retryInS = MinRetryS;

        /// <param name="scene">The component.</param>
        /// <param name="token">Returns the present token.</param>
        internal SceneSession(TerraportScene scene, Func<string> token)
        {
            settings = scene.Settings;
            budgets = settings.ActualBudgets;
            url = scene.SceneUrl;
            this.token = token;
            materials = new GroundMaterials(scene.DetailMaterial, scene.BaseMaterial, settings);
            Renderer = new GroundRenderer(scene.transform, photos, materials, settings.lit);
            Renderer.BaseFault += fault => Failed?.Invoke(fault);
            Load();
        }

        /// <summary>Files could not be loaded; it is tried again.</summary>
        internal event Action<TerraportException> Failed;

        /// <summary>Files of a version are here. The first time the visit has just been made.</summary>
        internal event Action<SceneFiles> Loaded;

        /// <summary>Null until the files are here.</summary>
        internal SceneClient Client { get; private set; }

        internal GroundRenderer Renderer { get; }

        internal float RadiusM => budgets.radiusM;

        /// <summary>Connect now, perhaps with another token; load again where that failed.</summary>
        internal void Reconnect(string newToken)
        {
            Client?.Reconnect(newToken);
            if (loading == null && (Client == null || Client.NeedsFiles)) retryAtS = 0;
        }

        /// <summary>Once per frame.</summary>
        internal void Update()
        {
            if (loading != null && loading.IsCompleted) TakeFiles();
            if (loading == null && Time.realtimeSinceStartup >= retryAtS) Load();
            photos.Step();
            if (Client == null) return;
            Client.Update(settings.ActualFrameBudgetMs);
            // Another version is served now.
            if (Client.NeedsFiles && loading == null && float.IsPositiveInfinity(retryAtS)) Load();
        }

        public void Dispose()
        {
            cancel.Cancel();
            Client?.Dispose();
            Renderer.Dispose();
            photos.Dispose();
            materials.Dispose();
        }

        private void Load()
        {
            retryAtS = float.PositiveInfinity;
            loading = LoadAsync();
        }

        // Async, so that what a project's own function for tokens throws is a failure like any other.
        private async Task<SceneFiles> LoadAsync()
        {
            return await SceneFiles.LoadAsync(url, token(), Platform.MakeHttp(), Renderer.PrepareBase, cancel.Token, Platform.RunAside);
        }

        private void TakeFiles()
        {
            // Cleared first: a listener of a failure may call Reconnect, which looks at it.
            Task<SceneFiles> finished = loading;
            loading = null;
            SceneFiles files;
            try
            {
                files = finished.GetAwaiter().GetResult();
            }
            catch (Exception error) when (!(error is OutOfMemoryException))
            {
                retryAtS = Time.realtimeSinceStartup + retryInS;
                retryInS = Math.Min(retryInS * 2, MaxRetryS);
                Failed?.Invoke(error as TerraportException ?? new TerraportException("load", error.Message, null, error));
                return;
            }
            retryInS = MinRetryS;
            if (Client == null)
                Client = new SceneClient(OptionsOf(files), files, Renderer, GroundVertex.Bytes);
            else
                Client.ReplaceFiles(files);
            // Published once more since the connection was made: another connection gets the newest version.
            if (Client.NeedsFiles)
            {
                retryAtS = Time.realtimeSinceStartup + MinRetryS;
                Client.Restart();
            }
            Loaded?.Invoke(files);
        }

        private SceneClientOptions OptionsOf(SceneFiles files)
        {
            // What is stated, or a quarter of what the device has (0 where it does not say): engine and app need the rest.
            long stated = budgets.maxGpuMebibytes, device = SystemInfo.graphicsMemorySize / 4;
            long gpuBytes = (device > 0 && device < stated ? device : stated) << 20;
            // The base has all vertices twice. An eighth of the rest is for what an aim brings and for places to return to; the others are for
            // two landings, of which one replaces the other.
            SegmentMesh ground = files.Base;
            long baseBytes = 2L * (GroundVertex.Bytes * ground.VertexCount + 6L * ground.FaceCount) + ground.ImageGpuBytes;
            long spareBytes = gpuBytes / 8, landingBytes = Math.Max(0, gpuBytes - baseBytes - spareBytes) / 2;
            return new SceneClientOptions {
                Session =
                    new SessionOptions {
                        Client = "terraport-unity/0.1.0 Unity/" + Application.unityVersion,
                        CreditBytes = (long)budgets.creditMebibytes << 20,
                        CacheBytes = (long)budgets.cacheMebibytes << 20,
                        // Told to the service, which cuts the plan: nothing is sent that would not be shown.
                        Budgets =
                            new Budgets {
                                MaxTriangles = budgets.maxTriangles,
                                MaxSegments = budgets.maxSegments,
                                MaxGpuBytes = landingBytes,
                                GpuVertexBytes = GroundVertex.Bytes,
                            },
                    },
                Token = token,
                Connect = Platform.Connect,
                DecodeThreads = Platform.HasThreads ? settings.ActualDecodeThreads : 0,
                SpareGpuBytes = spareBytes,
                DiskFolder = Platform.DiskFolder,
                DiskBytes = (long)budgets.diskMebibytes << 20,
                AutoShow = settings.autoShow,
                ShowsCoarse = settings.showsCoarse,
            };
        }
    }
}
