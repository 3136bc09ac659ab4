namespace Terraport.Unity
{
    /// <summary>What a scene holds; for a display.</summary>
    public struct SceneFigures
    {
        /// <summary>Segments on the graphics card, or on their way to it.</summary>
        public int Segments;

        /// <summary>Objects of Unity that were made for ground, spare ones too.</summary>
        public int Objects;

        /// <summary>Triangles that a camera that sees everything draws, per eye.</summary>
        public long DrawnTriangles;

        /// <summary>What was received.</summary>
        public StreamStats Stream;
    }
}
