using UnityEngine;

namespace Lpvbake
{
    /// <summary>A light volume of `--target unity`, as LpvbakeImporter makes it of NAME.unity.json.</summary>
    public class LpvbakeVolume : ScriptableObject
    {
        /// <summary>Of red, green and blue: x, y, z and 1 (SHAr of UnityCG.cginc, ...).</summary>
        public Texture3D r, g, b;
        /// <summary>xy, yz, z2, xz (SHBr, ...); null: the volume is of order 1.</summary>
        public Texture3D r2, g2, b2;
        /// <summary>x2 - y2 of the three colours (SHC); null as those.</summary>
        public Texture3D x2y2;
        /// <summary>The box in the world, metres.</summary>
        public Vector3 min, max;
        /// <summary>Rows of pictures run down, so that v is 1 - itself.</summary>
        public bool rowsRunDown;

        /// <summary>Gives the volume to all shaders that include Lpvbake.hlsl. The light is in nits;
        /// `intensity` is how much of the engine's unit one is.</summary>
        public void Apply(float intensity)
        {
            Shader.SetGlobalTexture("_LpvbakeR", r);
            Shader.SetGlobalTexture("_LpvbakeG", g);
            Shader.SetGlobalTexture("_LpvbakeB", b);
            if (r2 != null)
            {
                Shader.SetGlobalTexture("_LpvbakeR2", r2);
                Shader.SetGlobalTexture("_LpvbakeG2", g2);
                Shader.SetGlobalTexture("_LpvbakeB2", b2);
                Shader.SetGlobalTexture("_LpvbakeX2Y2", x2y2);
            }
            Shader.SetGlobalVector("_LpvbakeScale", UvwScale(r2 != null ? 2 : 1));
            Shader.SetGlobalVector("_LpvbakeOffset", UvwOffset(intensity));
        }

        /// <summary>uvw = position * scale + offset; w is `last`.</summary>
        public Vector4 UvwScale(float last)
        {
            float y = 1 / (max.y - min.y);
            return new Vector4(1 / (max.x - min.x), rowsRunDown ? -y : y, 1 / (max.z - min.z), last);
        }

        public Vector4 UvwOffset(float last)
        {
            Vector4 scale = UvwScale(0);
            return new Vector4(-min.x * scale.x, -(rowsRunDown ? max.y : min.y) * scale.y, -min.z * scale.z, last);
        }
    }
}
