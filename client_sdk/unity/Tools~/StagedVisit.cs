namespace Terraport.Tools
{
    /// <summary>
    /// A visit as an engine makes it: the stream's events go to a <see cref="SceneStage"/>, and a renderer that draws nothing
    /// notes what would be drawn.
    /// </summary>
    internal sealed class StagedVisit
    {
        /// <summary>What a frame gives the stage.</summary>
        private const double FrameMs = 2;

        private readonly RecordingRenderer renderer = new RecordingRenderer();
        private readonly DecodeThreads decoders;
        private readonly SceneStage stage;
        private readonly ShownGround ground;
        private readonly JsonText feet = new JsonText();

        public StagedVisit(ISceneStream stream, StreamOptions options)
        {
            SceneFiles files = SceneLoader.LoadAsync(options.SceneUrl, options.Token).GetAwaiter().GetResult();
            // Small blocks and two threads: a small scene then has many blocks and decodes that overtake each other.
            decoders = new DecodeThreads(2);
            ground = new ShownGround(renderer);
            stage = new SceneStage(stream, files, ground, decoders, new StageOptions { BaseBlockFaces = 16 });
        }

        /// <summary>Whether the newest landing is what is drawn.</summary>
        public bool IsShown => stage.Status.Phase == LandingPhase.Shown;

        public int Land(Vec3 position, double radiusM, LandOptions options) { return stage.Land(position, radiusM, options); }

        public void Handle(StreamEvent streamEvent) { stage.Handle(ref streamEvent); }

        /// <summary>One frame of the engine.</summary>
        public void Frame() { stage.Update(FrameMs); }

        /// <summary>Stand at a place: notes the height of the ground and its segment there; null where there is none.</summary>
        public void Stand(Vec3 position)
        {
            GroundPoint point;
            if (!ground.At(position, out point))
            {
                feet.Null();
                return;
            }
            feet.Open('[').Value(point.Position.Y).Value(point.Segment.HasValue ? (long)point.Segment.Value : -1).Close(']');
        }

        /// <summary>What is drawn, and what happened: one JSON object.</summary>
        public string Describe()
        {
            var json = new JsonText();
            json.Open('{').Key("visible").Values(renderer.Shown).Key("hidden_base_faces").Values(renderer.HiddenFaces);
            json.Key("swaps").Value((long)renderer.Swaps).Key("digest").Value(stage.VisibleDigest).Key("faults").Open('[');
            foreach (string fault in renderer.Faults) json.Value(fault);
            string text = json.Close(']').Close('}').ToString();
            return text.Substring(0, text.Length - 1) + ",\"feet\":[" + feet + "]}";
        }
    }
}
