using System.Collections.Generic;

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

        /// <summary>Of the ground that is made solid around feet.</summary>
        private const double SolidHalfM = 4;
        private const int SolidFaces = 4096;

        private readonly RecordingRenderer renderer = new RecordingRenderer();
        private readonly DecodeThreads decoders;
        private readonly SceneStage stage;
        private readonly ShownGround ground;
        private readonly GroupFollower follower;
        private readonly JsonText feet = new JsonText();
        private readonly List<float> solid = new List<float>();

        public StagedVisit(ISceneStream stream, StreamOptions options)
        {
            SceneFiles files = SceneLoader.LoadAsync(options.SceneUrl, options.Token).GetAwaiter().GetResult();
            // Small blocks and two threads: a small scene then has many blocks and decodes that overtake each other.
            decoders = new DecodeThreads(2);
            ground = new ShownGround(renderer);
            stage = new SceneStage(stream, files, ground, decoders, new StageOptions { BaseBlockFaces = 16 });
            follower = new GroupFollower(stream, stage);
        }

        /// <summary>Whether the newest landing is what is drawn.</summary>
        public bool IsShown => stage.Status.Phase == LandingPhase.Shown;

        public int Land(Vec3 position, double radiusM, LandOptions options) { return stage.Land(position, radiusM, options); }

        public void Aim(Vec3 position, double radiusM) { stage.Aim(position, radiusM); }

        /// <summary>Whether landings of the group are followed.</summary>
        public bool Follows
        {
            set {
                follower.Follows = value;
            }
        }

        public void Handle(StreamEvent streamEvent)
        {
            stage.Handle(ref streamEvent);
            follower.Handle(ref streamEvent);
        }

        /// <summary>One frame of the engine.</summary>
        public void Frame()
        {
            stage.Update(FrameMs);
            follower.Update();
        }

        /// <summary>Stand at a place: notes the height of the ground and its segment there; null where there is none.</summary>
        public void Stand(Vec3 position)
        {
            GroundPoint point;
            if (!ground.At(position, out point))
            {
                feet.Null();
                return;
            }
            feet.Open('[').Value(point.Position.Y).Value(point.Segment.HasValue ? (long)point.Segment.Value : -1);
            feet.Value(SolidHeight(point.Position)).Close(']');
        }

        /// <summary>Height of the highest solid face over a place; far below where there is none.</summary>
        private double SolidHeight(Vec3 place)
        {
            ground.Gather(place, SolidHalfM, SolidFaces, solid);
            double highest = -1e6;
            for (int at = 0; at < solid.Count; at += 9)
            {
                double ux = solid[at + 3] - solid[at], uy = solid[at + 4] - solid[at + 1], uz = solid[at + 5] - solid[at + 2];
                double vx = solid[at + 6] - solid[at], vy = solid[at + 7] - solid[at + 1], vz = solid[at + 8] - solid[at + 2];
                double x = place.X - solid[at], z = place.Z - solid[at + 2], area = ux * vz - uz * vx;
                double beta = (x * vz - z * vx) / area, gamma = (ux * z - uz * x) / area;
                if (beta >= -1e-9 && gamma >= -1e-9 && beta + gamma <= 1 + 1e-9)
                    highest = System.Math.Max(highest, solid[at + 1] + beta * uy + gamma * vy);
            }
            return highest;
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
