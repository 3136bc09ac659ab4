using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>A texture made from a payload's image.</summary>
    public struct PhotoTexture
    {
        /// <summary>The texture; whoever asked for it destroys it.</summary>
        public Texture2D Texture;

        /// <summary>Its first row is the image's uppermost, against Unity's habit: V has to be turned once more when it is drawn.</summary>
        public bool IsTopDown;
    }
}
