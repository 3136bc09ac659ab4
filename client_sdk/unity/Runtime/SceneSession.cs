using System;
using System.Threading;
using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// One opening of a scene: its files, its stream, its stage and what draws them, from Open to Close. Main thread.
    /// </summary>
    internal sealed class SceneSession : IDisposable
    {
        /// <summary>Faces of a block of the base: 13 blocks for 200,000 faces, and at most 96 KiB of indices to write for one.</summary>
        private const int BaseBlockFaces = 16384;

        /// <summary>Between two tries to load the files; doubled from the first to the second.</summary>
        private const float MinRetryS = 2;

        private const float MaxRetryS = 30;

        private readonly TerraportSettings settings;
        private readonly DeviceBudgets budgets;
        private readonly string url;
        private readonly ITransportFactory transports;
        private readonly IHttp http;
        private readonly PhotoLoader photos = new PhotoLoader();
        // Made here and disposed of here, all of them; the stream and the decoders once the files are loaded.
        private readonly GroundMaterials materials;
        private readonly GroundRenderer renderer;
        private readonly ShownGround ground;
        private readonly CancellationTokenSource cancel = new CancellationTokenSource();
        private string token;
        // Asked in place of it; null without.
        private Func<string> tokenProvider;
        // Null while nothing is loaded. Its continuations run on the main thread, which also polls it.
        private Task<SceneFiles> loading;
        private IDecodeQueue decoders;
        // Seconds of realtimeSinceStartup, which goes on while the game's time is scaled or stopped.
        private float retryAtS = float.PositiveInfinity;
        private float retryInS = MinRetryS;
        private bool isDisposed;
        // The landing that was told of as presentable, and whether all of it.
        private int presentable;
        private bool isPresentableWhole;

        public SceneSession(TerraportScene scene, string url, string token)
        {
            settings = scene.Settings;
            budgets = settings.ActualBudgets;
            this.url = url;
            this.token = token;
            tokenProvider = scene.TokenProvider;
            transports = scene.Transports;
            http = scene.Http ?? Platform.MakeHttp();
            materials = new GroundMaterials(scene.DetailMaterial, scene.BaseMaterial, settings);
            renderer = new GroundRenderer(scene.transform, photos, materials, BaseBlockFaces, settings.lit);
            ground = new ShownGround(renderer);
            renderer.BaseFault += fault => Fault(fault);
            loading = LoadAsync();
        }

        /// <summary>Files could not be loaded, a segment could not be decoded or drawn.</summary>
        public event Action<TerraportException> Faulted;

        /// <summary>The base's files of a version are here; it is drawn a few frames later.</summary>
        public event Action<SceneFiles> Loaded;

        /// <summary>Every event of the stream, after the stage has it.</summary>
        public event StreamEventHandler Streamed;

        /// <summary>What is drawn has changed: raised within Update, after the renderer has it.</summary>
        public event Action<SceneSwap> Swapped;

        /// <summary>With autoShow off: a landing, or its inner part, can be shown.</summary>
        public event Action<int> Presentable;

        /// <summary>Null until the files are here.</summary>
        public SceneStage Stage { get; private set; }

        /// <summary>Null until the files are here.</summary>
        public ISceneStream Stream { get; private set; }

        /// <summary>Of the version that is served now; null until they are here.</summary>
        public SceneFiles Files { get; private set; }

        /// <summary>What it holds on the graphics card, for a display of figures.</summary>
        public GroundRenderer Renderer => renderer;

        /// <summary>What is shown, for rays; nothing before the base is.</summary>
        public ShownGround Ground => ground;

        /// <summary>Whether the files are being loaded.</summary>
        public bool IsLoading => loading != null;

        /// <summary>Radius of a landing for which none is given, metres.</summary>
        public float RadiusM => budgets.radiusM;

        /// <summary>Connect now, perhaps with another token; begin to load again where that failed.</summary>
        public void Reconnect(string newToken)
        {
            newToken = string.IsNullOrEmpty(newToken) ? null : newToken;
            if (newToken != null)
            {
                token = newToken;
                tokenProvider = null;
            }
            if (Stream != null)
            {
                Stream.Reconnect(newToken);
            }
            if (loading == null && (Files == null || Stage.NeedsFiles))
            {
                retryAtS = 0;
            }
        }

        /// <summary>Once per frame: take what came, and do what the frame has time for.</summary>
        public void Update()
        {
            // Order within a frame: files, images, events of the stream, then what the frame's budget allows of decoding's results.
            TakeFiles();
            if (loading == null && Time.realtimeSinceStartup >= retryAtS)
            {
                Load();
            }
            photos.Step();
            if (Stage == null)
            {
                return;
            }
            Stream.Pump();
            StreamEvent next;
            while (Stream.TryNextEvent(out next))
            {
                // The stage first: a listener that asks for the status finds it up to date.
                Stage.Handle(ref next);
                if (Streamed != null)
                {
                    Streamed(ref next);
                }
            }
            Stage.Update(settings.ActualFrameBudgetMs);
            if (Stage.NeedsFiles && loading == null && float.IsPositiveInfinity(retryAtS))
            {
                Load(); // Another version is served now.
            }
            ReportPresentable();
        }

        /// <summary>Close the stream and free everything.</summary>
        public void Dispose()
        {
            if (isDisposed)
            {
                return;
            }
            isDisposed = true;
            // From the reader to the resources: whoever still uses something is disposed of before it.
            cancel.Cancel();
            if (Stage != null)
            {
                Stage.Dispose();
            }
            if (Stream != null)
            {
                Stream.Dispose();
            }
            if (decoders != null)
            {
                decoders.Dispose();
            }
            renderer.Dispose();
            photos.Dispose();
            materials.Dispose();
            cancel.Dispose();
        }

        /// <summary>Tell once of each landing that it can be shown, and once more where its inner part could be first.</summary>
        private void ReportPresentable()
        {
            if (isDisposed || Stage.AutoShow || Presentable == null)
            {
                return;
            }
            LandingStatus status = Stage.Status;
            bool isWhole = status.Phase == LandingPhase.Presentable;
            if (!isWhole && status.Phase != LandingPhase.DegradedPresentable)
            {
                return;
            }
            if (status.Landing != presentable || (isWhole && !isPresentableWhole))
            {
                presentable = status.Landing;
                isPresentableWhole = isWhole;
                Presentable(status.Landing);
            }
        }

        private void Load()
        {
            retryAtS = float.PositiveInfinity;
            loading = LoadAsync();
        }

        private async Task<SceneFiles> LoadAsync()
        {
            CancellationToken cancelled = cancel.Token;
            // The newest version at first; later exactly the one that the session has opened.
            string version = Stage != null && Stage.NeedsFiles ? Stage.NeededVersion : null;
            SceneFiles files = await SceneLoader.LoadAsync(
                url, tokenProvider == null ? token : tokenProvider(), http, null, cancelled, version, Platform.Aside);
            SceneFiles sorted = null;
            // Aside with the rest of the work: sorting a large base takes longer than a frame.
            Action prepare = () =>
            {
                sorted = BaseOrder.Sort(files, BaseBlockFaces);
                ground.Prepare(sorted);
            };
            if (Platform.Aside == null)
            {
                prepare(); // Its blocks are packed one by one while they are uploaded.
                return sorted;
            }
            prepare += () => BaseBlocks.PackOnto(sorted.Base, BaseBlockFaces);
            await Platform.Aside(prepare);
            return sorted;
        }

        private void TakeFiles()
        {
            if (loading == null || !loading.IsCompleted)
            {
                return;
            }
            // Cleared first: a listener of a failure may call Reconnect, which looks at it.
            Task<SceneFiles> finished = loading;
            loading = null;
            if (finished.IsFaulted || finished.IsCanceled)
            {
                // Cancelled, but not by us, who take nothing after that: a project's own IHttp tells a timeout so.
                Exception error =
                    finished.IsFaulted ? finished.Exception.GetBaseException() : new TimeoutException("loading was cancelled");
                retryAtS = Time.realtimeSinceStartup + retryInS;
                // Doubled up to half a minute, as connections are: a restarted server is not met by everybody at once.
                retryInS = Math.Min(retryInS * 2, MaxRetryS);
                Fault(error as TerraportException ?? new TerraportException("load", error.Message, null, error));
                return;
            }
            retryInS = MinRetryS;
            if (Stage != null && Stage.NeededVersion != null && finished.Result.Manifest.Version != Stage.NeededVersion)
            {
                return; // Published once more while these were loaded: Update asks for the newer ones.
            }
            Files = finished.Result;
            if (Stage != null)
            {
                Stage.ReplaceFiles(Files);
            }
            else if (!TryBegin())
            {
                return;
            }
            if (Loaded != null)
            {
                Loaded(Files);
            }
        }

        /// <summary>False, and told, where a setting does not serve: trying again would not help, before somebody reconnects.</summary>
        private bool TryBegin()
        {
            try
            {
                Begin();
                return true;
            }
            catch (TerraportException error)
            {
                Fault(error);
            }
            catch (ArgumentException error)
            {
                Fault(new TerraportException("settings", error.Message, null, error));
            }
            // Undo what was begun, so that a Reconnect begins from the start.
            if (Stream != null)
            {
                Stream.Dispose();
                Stream = null;
            }
            if (decoders != null)
            {
                decoders.Dispose();
                decoders = null;
            }
            Files = null;
            return false;
        }

        private void Begin()
        {
            // After the files: a server's address names its scene only then, and a landing needs the base anyway.
            Stream = Platform.OpenStream(OptionsOf(), transports);
            // PackOnto runs where the decode runs: on a thread, wherever there is one.
            decoders = Platform.MakeDecoders(settings, PackedMesh.PackOnto);
            StageOptions options = new StageOptions();
            options.AutoShow = settings.autoShow;
            options.ShowsCoarse = settings.showsCoarse;
            options.SpareGpuBytes = Budgets.SpareOf(GpuShareBytes);
            options.BaseBlockFaces = BaseBlockFaces;
            Stage = new SceneStage(Stream, Files, ground, decoders, options);
            Stage.DecodeFailed += (segment, error) => Fault(error);
            Stage.Swapped += swap =>
            {
                if (Swapped != null)
                {
                    Swapped(swap);
                }
            };
        }

        /// <summary>What is stated, or a quarter of what the device has: engine and app need the rest.</summary>
        private long GpuShareBytes
        {
            get {
                long stated = budgets.maxGpuMebibytes;
                // 0 where the system does not tell.
                long device = SystemInfo.graphicsMemorySize / 4;
                return (device > 0 && device < stated ? device : stated) << 20;
            }
        }

        private StreamOptions OptionsOf()
        {
            StreamOptions options = new StreamOptions();
            SceneUrl address = SceneUrl.Parse(url);
            // A server's address stands for its only scene, which the files have named.
            options.SceneUrl = address.Scene != null ? url : address.ScenesUrl + "/" + Uri.EscapeDataString(Files.Manifest.Id);
            options.Token = string.IsNullOrEmpty(token) ? null : token; // An empty field of a form is no token.
            options.TokenProvider = tokenProvider;
            Budgets bounds = new Budgets();
            // Sent to the server, which then cuts the plan: nothing is sent that would not be shown.
            bounds.MaxTriangles = budgets.maxTriangles;
            bounds.MaxSegments = budgets.maxSegments;
            bounds.MaxGpuBytes = Budgets.LandingOf(GpuShareBytes, Files.Base);
            bounds.GpuVertexBytes = PackedMesh.VertexBytes;
            options.Budgets = bounds;
            options.CacheBytes = (long)budgets.cacheMebibytes << 20;
            options.DiskFolder = Platform.DiskFolder;
            options.DiskBytes = (long)budgets.diskMebibytes << 20;
            options.CreditBytes = (long)budgets.creditMebibytes << 20;
            options.Client = ClientVersion.Text + " Unity/" + Application.unityVersion;
            return options;
        }

        private void Fault(TerraportException error)
        {
            if (Faulted != null)
            {
                Faulted(error);
            }
        }
    }
}
